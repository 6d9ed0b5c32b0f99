#!/usr/bin/env python3
"""Boolean and Integer signals live: the transport system by Modbus TCP.

The belts are a coil and a discrete input, and a count is a register. A Boolean synchronises the
twin in real time. The replay must give the same bits.
"""
import signal

from live_test import RESULTS, Program, check_database, end_well, expect_repeated, free_port, number, query
from twinlock_test import SOURCE, edited_config, expect, main, read_table, replay_json, scratch

U = "belt2.enabled"
SECONDS = 3.5
BEGIN_S = 2.5  # of the recording: half a second later belt 2 is switched on, and the product gets stuck


def recording(folder):
    """The part of the product's recording in which it is stuck, with a count of the belts'
    changes."""
    table = read_table(SOURCE / "config" / "transport" / "slow_recording.csv")
    rows, count, before = ["t,x,enabled1,enabled2,messages"], 0, (0.0, 0.0)
    for time, x, *belts in zip(table["t"], table["x"], table["enabled1"], table["enabled2"]):
        if time >= BEGIN_S:
            count += sum(a != b for a, b in zip(belts, before))
            before = belts
            rows.append(f"{time - BEGIN_S:.6f},{x!r},{belts[0]:g},{belts[1]:g},{count}")
    path = folder / "hang.csv"
    path.write_text("\n".join(rows) + "\n")
    return path


def configuration():
    def modbus(table, address, **more):
        return {"modbus": {"source": "control", "table": table, "address": address, **more}}
    return edited_config("transport/slow.json", {
        "duration_s": SECONDS,
        "sources": {"control": {"modbus_tcp": {"host": "127.0.0.1", "port": free_port(), "period_s": 0.01}}},
        "components": {"product": {"set": {"y_start": 285}}},  # mm: where belt 1 ends and belt 2 begins
        "plant": {"enabled1": modbus("coil", 3), "enabled2": modbus("discrete", 9),
                  "messages": {"type": "integer", **modbus("holding", 4, type="int16")},
                  "x": modbus("input", 0, type="float32")},
        "recording": {"file": str(recording(scratch()))},
        "synchronise": {"epsilon": None, "match": {"product.x": {"tolerance": 5},
                                                   "process.messages": {"to": "plant.messages", "weight": 0}}},
        "record": {"file": "run.db"}, "realtime": {"priority": 0, "lock_memory": False}})


def test_booleans_by_modbus():
    config = configuration()
    database = config.parent / "run.db"
    with Program("plant", config) as plant:
        plant.wait_for("control|4 signals|Modbus TCP")
        with Program("run", config, "--json") as run:
            told, _ = end_well(run)
        code, _, log = plant.end(signal.SIGTERM)
    expect(code == 0, f"the plant ended with {code}\n{log}")
    check_database(database)
    rows = number(database, "SELECT count(*) FROM steps")
    for name, values in (("enabled1", {0, 1}), ("enabled2", {0, 1}), ("messages", {1, 3})):
        found = {value for value, in query(database, "SELECT DISTINCT value FROM v_samples WHERE name LIKE ? AND "
                                           "quality = 'good'", f"%{name}")}
        expect(found == values, f"{name} was read as {found}")
    u = [value for value, in query(database, "SELECT applied FROM adjustments ORDER BY step")]
    nominal = [value for value, in query(database, "SELECT nominal FROM adjustments ORDER BY step")]
    expect(set(nominal) == {0, 1}, f"the nominal value never changes: {set(nominal)}")
    hangs = u[:round((5.0 - BEGIN_S) / 0.05)]
    expect(not any(hangs), f"belt 2 was on while the product was stuck, in {sum(hangs)} steps")
    counted = [y for y, in query(database, "SELECT simulated FROM v_outputs WHERE name = 'process.messages' ORDER BY step")]
    expect(counted[-1] == 3 and set(counted) <= {0, 1, 2, 3}, f"messages counted: {set(counted)}")
    again = scratch() / "again.db"
    repeated = replay_json(config, "--recording", database, "--db", again)
    expect(repeated["adjust"] == told["adjust"] and repeated["match"] == told["match"], f"{repeated}\n{told}")
    expect_repeated(database, 1, again, RESULTS, 2 * rows)


if __name__ == "__main__":
    main()

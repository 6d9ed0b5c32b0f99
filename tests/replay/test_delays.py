#!/usr/bin/env python3
"""Which values `delays` pair. In these recordings each value is the time of its reading in ms, so it shows which reading was
used. The FMU outputs its input one step later."""
import math

from twinlock_test import (edited_config, expect, expect_line, main, replay_csv, replay_json, run, run_well,
                           scratch, write_config)

STEP = 10  # ms
END = 500


def delays(output=None, wait=1, inputs=None):
    """Shifts of outputs (Δo) and of inputs (Δi), and the longest wait for the next ŷ; all in ms."""
    def pair(delay):
        late, none = ["late", "base"], ["base"]
        return {"simulation": late if delay > 0 else none, "plant": none if delay > 0 else late}

    participants = {"base": {"cycle_s": wait / 1000}}
    section = {"participants": participants, "synchronous": []}
    for key, delay in (("input", inputs), ("output", output)):
        if delay is not None:
            name = f"{key}_late"
            participants[name] = {"dead_s": abs(delay) / 1000, "cycle_s": 1}
            section[key] = {side: [name if part == "late" else part for part in chain]
                            for side, chain in pair(delay).items()}
            section["synchronous"].append(name)
    section["synchronous"] = [[*section["synchronous"], "base"]]
    return section


def config(section, signals=("u", "y"), **changes):
    fed, matched = signals
    document = {
        "twinlock": 1, "name": "clock", "step_s": STEP / 1000,
        "components": {"wire": {"fmu": "lag.fmu", "set": {"T": STEP / 1000, "t_step": STEP / 1000}}},
        "plant": {name: {} for name in dict.fromkeys(signals)},
        "connect": [[f"plant.{fed}", "wire.u"]],
        "compare": {"wire.y": {"to": f"plant.{matched}"}},
    }
    return write_config({**document, "delays": section, **changes})


def recording(u_stamps, y_stamps):
    """A recording with rows at all stamps (ms). A signal has values only at its own stamps."""
    path = scratch() / "recording.csv"
    rows = [f"{stamp / 1000:.9f},{stamp if stamp in u_stamps else ''},{stamp if stamp in y_stamps else ''}"
            for stamp in sorted({0, *u_stamps, *y_stamps})]
    path.write_text("time,u,y\n" + "\n".join(rows) + "\n", encoding="utf-8")
    return path


def every(period, phase=0):
    return [round(phase + period * i, 6) for i in range(int((END - phase) / period) + 1)]


def ticks_of(shift, wait):
    return math.ceil(round((shift + wait) / STEP, 9))


def paired(step, stamps, shift, wait):
    """The reading paired with y of a step: the first one after its instant that has arrived in time, else the last one before."""
    at = (step + 1) * STEP + shift
    by = (step + 1 + ticks_of(shift, wait)) * STEP
    later = [stamp for stamp in stamps if at - 1e-6 <= stamp <= by + 1e-6]
    return later[0] if later else max(stamp for stamp in stamps if stamp <= at)


def expect_column(table, name, wanted, what):
    """`wanted`: step → value, or None if the value does not matter."""
    steps = [int(step) for step in table["step"]]
    expect(len(steps) > 30, f"{what}: only {len(steps)} steps")
    for step, found in zip(steps, table[name]):
        value = wanted(step)
        expect(value is None or abs(found - value) < 1e-9, f"{what}: at step {step} found {found}, wanted {value}")


def test_outputs_are_shifted_both_ways_and_by_parts_of_a_step():
    stamps = every(1)
    for delay in (-25, -10, -3, -0.5, 0, 0.5, 3, 8, 10, 13, 27):
        table = replay_csv(config(delays(output=delay)), "--recording", recording(stamps, stamps))
        expect_column(table, "plant.y", lambda step: math.ceil(max((step + 1) * STEP - delay, 0)), f"delay {delay} ms")
        expect_column(table, "wire.y", lambda step: step * STEP, f"inputs at delay {delay} ms")


def test_y_before_the_recording_began_is_not_compared():
    table = replay_csv(config(delays(output=27)), "--recording", recording(every(1), every(1)))
    qualities = table["plant.y quality"]
    expect(qualities[:1] == ["no link"] and set(qualities[2:]) == {"good"}, f"{qualities[:4]}")


def test_the_next_available_reading():
    for period, phase in ((7, 3), (13, 0), (8, 1.5), (33, 20)):
        stamps = every(period, phase)
        for delay in (-6, 0, 2.5, 8, 20):
            shift = -delay
            what = f"a reading every {period} ms, delay {delay} ms"
            table = replay_csv(config(delays(output=delay, wait=period)), "--recording", recording(every(10), stamps))
            expect_column(table, "plant.y", lambda step: paired(step, stamps, shift, period) if step > 6 else None, what)
            late = [found - ((step + 1) * STEP + shift) for step, found in zip(table["step"], table["plant.y"])][7:]
            expect(all(-1e-9 <= value <= period for value in late), f"{what}: {min(late)} … {max(late)} ms late")


def test_the_last_reading_bridges_a_gap_until_it_is_stale():
    stamps = [stamp for stamp in every(10) if not 200 < stamp < 300]
    path = recording(every(10), stamps)
    section = delays(output=5, wait=10)
    table = replay_csv(config(section), "--recording", path)
    expect_column(table, "plant.y", lambda step: paired(step, stamps, -5, 10), "a gap")
    expect(set(table["plant.y quality"]) == {"good"}, "without stale_s a value stays good")
    table = replay_csv(config(section, plant={"u": {}, "y": {"stale_s": 0.04}}), "--recording", path)
    for step, quality in zip(table["step"], table["plant.y quality"]):
        at = (step + 1) * STEP - 5
        wanted = "stale" if 240 < at < 285 else "good"
        expect(quality == wanted, f"at step {step}: {quality}, wanted {wanted}")


def test_inputs_are_those_seen_later_or_earlier():
    stamps = every(1)
    for delay in (-13, -4.5, 0, 3, 11.9, 20):
        table = replay_csv(config(delays(inputs=delay)), "--recording", recording(stamps, stamps))
        expect_column(table, "wire.y", lambda step: math.floor(max(step * STEP + delay, 0)) if step > 2 else None,
                      f"inputs {delay} ms")
        expect_column(table, "plant.y", lambda step: (step + 1) * STEP, f"outputs at inputs {delay} ms")


def test_inputs_and_outputs_together():
    """Δo includes Δi, so y and ŷ of the same command are paired."""
    stamps = every(1)
    for output, inputs in ((8, 12), (8, 3), (-5, 7), (4, -6)):
        table = replay_csv(config(delays(output, 1, inputs)), "--recording", recording(stamps, stamps))
        expect_column(table, "wire.y", lambda step: step * STEP + inputs if step > 3 else None, "inputs")
        expect_column(table, "plant.y", lambda step: (step + 1) * STEP + inputs - output if step > 3 else None, "ŷ")


def test_a_signal_that_feeds_an_input_and_is_matched():
    stamps = every(1)
    path = recording(stamps, stamps)
    table = replay_csv(config(delays(6, 1, 13), ("y", "y")), "--recording", path)
    expect_column(table, "wire.y", lambda step: step * STEP + 13, "as an input")
    expect_column(table, "plant.y", lambda step: (step + 1) * STEP + 7, "as a measurement")
    table = replay_csv(config(delays(6), ("y", "y")), "--recording", path)
    expect_column(table, "wire.y", lambda step: step * STEP, "as an input, not shifted")
    expect_column(table, "plant.y", lambda step: (step + 1) * STEP - 6, "as a measurement")


def test_a_step_waits_for_its_readings():
    for section, lead in ((delays(output=27), 1), (delays(output=-3), 2), (delays(output=-3, wait=10), 3),
                          (delays(inputs=12), 3), (delays(8, 8, 12), 3), (delays(inputs=-20), 1)):
        page = run_well(["check", config(section)])
        expect_line(page, f"i + {lead}")


def steps_of(chosen, *options):
    """The bytes that `replay --csv` writes."""
    path = scratch() / "steps.csv"
    run_well(["replay", chosen, "--csv", path, *options])
    return path.read_bytes()


def test_a_database_replays_to_the_bit():
    stamps, offbeat = every(1), every(7, 3)
    for signals, section in ((("u", "y"), delays(8.5, 7, 12)), (("y", "y"), delays(-6, 7, 2.5))):
        chosen, database = config(section, signals), scratch() / "run.db"
        wanted = steps_of(chosen, "--recording", recording(stamps, offbeat), "--db", database)
        expect(wanted.count(b"\n") > 30, "there are no steps")
        expect(wanted == steps_of(chosen, "--recording", database), "the same configuration")
        other = edited_config(chosen, {"name": "another"})
        expect(wanted == steps_of(other, "--recording", database), "another configuration, the same delays")


def test_a_run_without_delays_is_replayed_with_them():
    """The database has one reading of each tick, with its stamp."""
    stamps = every(10, 4)
    folder = scratch()
    for signals in (("u", "y"), ("y", "y")):
        plain = config(delays(), signals)
        document = edited_config(plain, {"delays": None})
        database = folder / f"{signals[0]}.db"
        run_well(["replay", document, "--recording", recording(every(10), stamps), "--db", database])
        table = replay_csv(config(delays(output=12, wait=10), signals), "--recording", database)
        expect_column(table, "plant.y", lambda step: paired(step, stamps, -12, 10) if step > 2 else None, "with delays")


def test_a_synchronised_twin_is_matched_with_the_shifted_measurement():
    """The plant equals the twin and is measured 20 ms late. With this delay configured, there is nothing to correct."""
    path = scratch() / "recording.csv"
    y, rows, late = 0.0, [], [0.0] * 20
    for ms in range(4000):
        u = 2 * (ms // 600 % 2)
        rows.append(f"{ms / 1000:.3f},{u!r},{late[0]!r}")
        late = [*late[1:], y]
        y += 0.001 * (u - y) / 0.1
    path.write_text("time,u,y\n" + "\n".join(rows) + "\n", encoding="utf-8")
    changes = {"components": {"wire": {"set": {"T": 0.1, "t_step": 0.001}}}, "compare": None,
               "synchronise": {"adjust": {"wire.T": {"step": 0.02, "min": 0.01, "max": 1}},
                               "match": {"wire.y": {"to": "plant.y", "tolerance": 0.05}}}}
    corrected = {}
    for delay, section in ((20, delays(output=-20)), (0, None)):
        chosen = edited_config(config(delays(output=0)), {**changes, "delays": section})
        told = replay_json(chosen, "--recording", path)
        expect(told["ledger"]["total"]["difference"] == 0, f"{told['ledger']}")
        corrected[delay] = max(abs(u - 0.1) for u in replay_csv(chosen, "--recording", path)["wire.T"])
    print(f"    largest correction of T = 0.1: {corrected[20]:.4f} with the delay, {corrected[0]:.4f} without")
    expect(corrected[20] < 0.02 and corrected[0] > 0.1, f"{corrected}")


def test_mode_ahead_waits_for_no_reading_and_check_warns():
    changes = {"compare": None, "synchronise": {"adjust": {"wire.T": {"step": 0.01, "min": -10, "max": 10}}, "horizon": {"measurements": "ahead"},
                                                "match": {"wire.y": {"to": "plant.y", "tolerance": 1}}}}
    page = run_well(["check", edited_config(config(delays(output=-12, inputs=30)), changes)])
    expect("\n  delays: " in page, page)
    expect_line(page, "ahead|i + 0")
    page = run_well(["check", edited_config(config(delays(output=12)), changes)])
    expect("\n  delays: " not in page, page)
    expect("\nwarnings\n" not in page and "warning" not in page.splitlines()[-1], page)


def test_check_draws_the_chains_in_80_columns():
    for section in (delays(8, 8, 12), delays(-100, 0.001), delays(inputs=4)):
        page = run_well(["check", config(section)])
        lines = page.splitlines()[1:]
        expect(max(map(len, lines)) <= 80, max(lines, key=len))
        expect("delays\n" in page and "█" in page, page)


def test_bad_delays_are_refused():
    section = delays(output=8)
    section["output"]["plant"] = ["nobody"]
    code, _, err = run(["check", config(section)])
    expect(code == 65, err)
    expect_line(err, 'error|line 52|delays.output.plant[0]|"nobody"|participant|base')


if __name__ == "__main__":
    main()

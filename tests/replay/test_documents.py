#!/usr/bin/env python3
"""The configurations in README.md and docs/your-plant.md work. The program has the messages of docs/troubleshooting.md."""
import re

from twinlock_test import BAD_DATA, SOURCE, expect, expect_line, main, run, run_well, scratch

README = (SOURCE / "README.md").read_text(encoding="utf-8")
PAGE = (SOURCE / "docs/your-plant.md").read_text(encoding="utf-8")
MESSAGES = SOURCE / "docs/troubleshooting.md"
# Messages of libmodbus, the C library and Python.
FOREIGN = {"Connection refused", "No route to host", "Illegal data address", "Illegal function", "Target device failed to respond",
           "Connection reset by peer", "Address already in use", "CERTIFICATE_VERIFY_FAILED"}
SHORTEST = 6  # letters; shorter parts of a message are not looked up


def blocks(text, language="json"):
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.M | re.S)


def written(text):
    path = scratch() / "motor.json"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_readme_has_ten_lines_that_work():
    (ten,) = blocks(README)
    expect(len(ten.splitlines()) <= 10, f"{len(ten.splitlines())} lines")
    expect("no problem found" in run_well(["check", written(ten)]), "a problem")


def test_the_first_configuration_of_the_page_asks_for_inputs():
    code, out, err = run(["check", written(blocks(PAGE)[0]), "--variables"])
    shown = [line for line in blocks(PAGE, "text")[0].splitlines() if line and not line.startswith(("$", "  …", "variables"))]
    expect(code == BAD_DATA and len(shown) == 7, f"{code}, {len(shown)} lines")
    for line in shown:
        expect(line.split(": line 3: ")[-1] in out + err, f"not printed: {line}\n{out}{err}")


def test_the_second_one_runs_free_and_the_third_one_locks():
    free = blocks(PAGE)[1]
    expect("no problem found" in run_well(["check", written(free)]), "a problem")
    (lock,) = [block for block in blocks(PAGE, "text") if block.lstrip().startswith('"synchronise"')]
    changed = re.sub(r'^  "compare": .*\n', lambda _: lock, free, flags=re.M).replace(', "set": { "I_in": 0.32 }', "")
    for signal, column in (("torque", "M_brake"), ("omega", "omega")):
        changed = changed.replace(f'"{signal}": {{\n', f'"{signal}": {{\n      "csv": {{ "column": "{column}" }},\n')
    changed = changed.replace('"record"', '"recording": { "time_column": "t" },\n  "record"')
    out = run_well(["replay", written(changed), "--recording", SOURCE / "config/motor/recording.csv", "--require-lock", "99"])
    expect_line(out, "in lock|100.0 %")


def is_composed(part, text):
    """True if a space divides `part` into two that `text` has: the program composes some messages of two texts."""
    words = part.split()
    return any(" ".join(words[:at]) in text and " ".join(words[at:]) in text for at in range(1, len(words)))


def test_messages_are_those_of_the_sources():
    text = ""
    for folder in "firmware", "board", "master", "script":
        for path in [*(SOURCE / folder).rglob("*.[ch]"), *(SOURCE / folder).glob("demo")]:
            text += re.sub(r'"\s*\n\s*"|"\s*PRI\w+\s*"', "", path.read_text(encoding="utf-8")).replace('\\"', '"')
    text = re.sub(r"%[-+.*0-9]*(?:ll|l|z)?[a-zA-Z]", "…", text).replace("%%", "%").replace("\\342\\200\\246", "…")
    looked_up = 0
    for cells in re.findall(r"^\| (.*?) \| ", MESSAGES.read_text(encoding="utf-8"), re.M):
        for message in re.findall(r"`([^`]+)`", cells):
            for part in re.split(r"…|\d+|: |; |, | \(", message):
                part = part.strip(' .,:;"%()')
                if len(part) >= SHORTEST and part not in FOREIGN:
                    looked_up += 1
                    expect(part in text or is_composed(part, text), f"no message has \"{part}\": {message}")
    expect(looked_up > 100, f"{looked_up} parts")


if __name__ == "__main__":
    main()

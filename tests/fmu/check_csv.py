#!/usr/bin/env python3
"""Tests the CSV FMU with FMPy: files, FIFOs, rollback, and errors in a file.

Usage: check_csv.py FMU [--write-reference]     exit 1 if a test failed; a line for each
"""

import faulthandler
import locale
import os
import random
import struct
import subprocess
import sys
import tempfile
import traceback
from contextlib import contextmanager
from ctypes import CDLL, byref, c_char_p, c_uint
from pathlib import Path

from check_fmus import Fmu, fmi2, fmpy, status_of

STEP_S = 0.01


class Bench:
    """The FMU, and a folder for the files of one test."""

    def __init__(self, fmu, folder):
        self.fmu, self.folder = fmu, Path(folder)

    def file(self, text, name="data.csv"):
        path = self.folder / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    def fifo(self):
        path = self.folder / "fifo"
        os.mkfifo(path)
        return path

    def instance(self, **values):
        """A slave before initialisation; `values` by the names of the FMU's variables."""
        self.fmu.messages.clear()
        slave = self.fmu.instantiate()
        self.set(slave, **values)
        slave.setupExperiment(startTime=0.0)
        return slave

    def set(self, slave, **values):
        for name, value in values.items():
            variable = self.fmu.variables[name]
            if variable.type == "String":
                slave.setString([variable.valueReference], [str(value)])
            else:
                self.fmu.set(slave, name, value)

    def start(self, **values):
        slave = self.instance(**values)
        slave.enterInitializationMode()
        slave.exitInitializationMode()
        return slave

    def y(self, slave, count=1):
        values = self.fmu.get(slave, [f"y{i + 1}" for i in range(count)])
        return values[0] if count == 1 else values

    def run(self, slave, steps, first=0, count=1):
        """y1 … y`count` after each of `steps` steps."""
        values = []
        for i in range(first, first + steps):
            slave.doStep(i * STEP_S, STEP_S, fmi2.fmi2False)
            values.append(self.y(slave, count))
        return values

    def expect_refused(self, call, *words):
        """The call ends with fmi2Error and a message with all `words`."""
        self.fmu.messages.clear()
        status = status_of(call)
        said = " | ".join(self.fmu.messages)
        expect(status == fmi2.fmi2Error, f"status {status}, wanted fmi2Error; {words}")
        for word in words:
            expect(str(word) in said, f"the message lacks {word!r}: {said!r}")


def expect(condition, text):
    if not condition:
        raise AssertionError(text)


def equal(found, wanted):
    expect(found == wanted, f"found {found}, wanted {wanted}")


def bits(values):
    return [struct.pack("<d", value) for value in values]


# ---- files ----


def test_description(bench):
    equal(fmpy.validation.validate_fmu(bench.fmu.path), [])


def test_reference(bench):
    """The values of fmus/csv/input.csv every 10 ms are those of fmus/csv/reference.csv."""
    folder = Path(__file__).resolve().parents[2] / "fmus" / "csv"
    columns = ("force", "switch", "temperature", "force")
    slave = bench.start(file=folder / "input.csv", **{f"column{i + 1}": name for i, name in enumerate(columns)})
    rows = [[0.0, *bench.y(slave, 4)]]
    rows += [[(i + 1) * STEP_S, *values] for i, values in enumerate(bench.run(slave, 100, 0, 4))]
    lines = ["time,y1,y2,y3,y4", *(",".join(map(repr, [round(time, 9), *values])) for time, *values in rows)]
    text = "\n".join(lines) + "\n"
    if "--write-reference" in sys.argv:
        (folder / "reference.csv").write_text(text, encoding="utf-8")
    equal(text, (folder / "reference.csv").read_text(encoding="utf-8"))


def test_held_until_the_next_row(bench):
    """The time is that of the step's end: a row at 0.02 counts after the step that ends there."""
    file = bench.file("time,a\n0,1\n0.02,2\n0.035,3\n")
    slave = bench.start(file=file, column1="a")
    equal(bench.y(slave), 1.0)
    equal(bench.run(slave, 5), [1.0, 2.0, 2.0, 3.0, 3.0])


def test_every_row_of_a_grid_is_met(bench):
    """Row i counts after step i, although a master's clock has rounding errors of sums."""
    file = bench.file("time,a\n" + "".join(f"{i / 100},{i}\n" for i in range(3001)))
    slave = bench.start(file=file, column1="a")
    time = 0.0
    for i in range(1, 3001):
        slave.doStep(time, STEP_S)
        time += STEP_S
        equal(bench.y(slave), float(i))


def test_initial_until_there_is_a_value(bench):
    file = bench.file("t,a,b\n0.015,,5\n0.03,7,\n")
    slave = bench.start(file=file, time_column="t", column1="a", column2="b", initial1=-1, initial2=-2, initial3=-3)
    equal(bench.y(slave, 3), [-1.0, -2.0, -3.0])
    equal(bench.run(slave, 3, count=3), [[-1, -2, -3], [-1, 5, -3], [7, 5, -3]])


def test_eight_columns_in_any_order(bench):
    names = [f"c{i}" for i in range(8)]
    file = bench.file(",".join(["time", *names]) + "\n0," + ",".join(map(str, range(8))) + "\n")
    slave = bench.start(file=file, **{f"column{i + 1}": names[7 - i] for i in range(8)})
    equal(bench.y(slave, 8), [float(7 - i) for i in range(8)])


def test_spreadsheet_habits(bench):
    """Byte order mark, CRLF, a comma in quotes, spaces, blank lines, an exponent."""
    file = bench.file(b'\xef\xbb\xbf"time" , "speed, rad/s"\r\n\r\n0, "1.5e2" \r\n\t\r\n 0.01 ,-2\r\n')
    slave = bench.start(file=file, column1="speed, rad/s")
    equal([bench.y(slave), *bench.run(slave, 1)], [150.0, -2.0])


def test_times_from_the_first_row(bench):
    file = bench.file("time,a\n1700000000.5,1\n1700000000.52,2\n")
    equal(bench.run(bench.start(file=file, column1="a", from_first=True), 3), [1.0, 2.0, 2.0])
    equal(bench.run(bench.start(file=file, column1="a"), 3), [0.0, 0.0, 0.0])


def test_parameters_while_initialising(bench):
    """In any order; the last values count."""
    one, two = bench.file("time,a\n0,1\n"), bench.file("t,b\n0,2\n", "other.csv")
    slave = bench.instance()
    slave.enterInitializationMode()
    bench.set(slave, column1="a", file=one)
    equal(bench.y(slave), 1.0)
    bench.set(slave, column1="b", time_column="t", file=two)
    equal(bench.y(slave), 2.0)
    slave.exitInitializationMode()
    equal(bench.run(slave, 1), [2.0])


def test_a_file_that_grows(bench):
    """A row counts when its line is complete."""
    file = bench.file("time,a\n0,1\n0.02,")
    slave = bench.start(file=file, column1="a")
    equal(bench.run(slave, 2), [1.0, 1.0])
    with open(file, "a", encoding="utf-8") as more:
        more.write("25")
        more.flush()
        equal(bench.run(slave, 1, 2), [1.0])
        more.write("0\n")
    equal(bench.run(slave, 1, 3), [250.0])


def test_reset_reads_the_file_again(bench):
    file = bench.file("time,a\n0,1\n0.01,2\n")
    slave = bench.start(file=file, column1="a")
    equal(bench.run(slave, 1), [2.0])
    bench.file("time,a\n0,3\n0.01,4\n")
    slave.reset()
    bench.set(slave, file=file, column1="a")
    slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    equal([bench.y(slave), *bench.run(slave, 1)], [3.0, 4.0])


def test_texts_read_back(bench):
    slave = bench.start(file=bench.file("time,ä\n0,1\n"), column1="ä")
    variable = bench.fmu.variables["column1"]
    value = c_char_p()
    slave.fmi2GetString(slave.component, (c_uint * 1)(variable.valueReference), 1, byref(value))
    equal(value.value.decode(), "ä")


def decimal_comma(folder):
    """Sets a locale with decimal comma, made from Debian's package `locales`."""
    libc = CDLL(None)
    libc.setlocale.restype = c_char_p
    subprocess.run(["localedef", "-i", "de_DE", "-f", "UTF-8", folder / "de_DE.UTF-8"], check=True)
    os.environ["LOCPATH"] = str(folder)
    chosen = libc.setlocale(locale.LC_NUMERIC, b"de_DE.UTF-8")
    del os.environ["LOCPATH"]
    equal(chosen, b"de_DE.UTF-8")


def test_another_locale(bench):
    """Numbers have a decimal point in each locale of the process."""
    decimal_comma(bench.folder)
    try:
        equal(bench.y(bench.start(file=bench.file("time,a\n0,1.5\n"), column1="a")), 1.5)
        refused_at_the_start(bench, '"1,5"', file=bench.file('time,a\n0,"1,5"\n'), column1="a")
    finally:
        CDLL(None).setlocale(locale.LC_NUMERIC, b"C")


# ---- rollback ----


def random_file(bench, rows=400):
    numbers = random.Random(1)
    time, lines = 0.0, ["time,a,b"]
    for _ in range(rows):
        time += numbers.uniform(0.001, 0.03)
        lines.append(f"{time},{numbers.random()},{numbers.choice(['', numbers.random()])}")
    return bench.file("\n".join(lines) + "\n")


def test_rollback(bench):
    """Random restores give the bits of one run; so do serialised states in another instance."""
    values = {"file": random_file(bench), "column1": "a", "column2": "b"}
    wanted = bench.run(bench.start(**values), 300, count=2)
    slave, other = bench.start(**values), bench.fmu.instantiate()
    states, numbers, at = {0: slave.getFMUstate()}, random.Random(2), 0
    for _ in range(60):
        steps = min(numbers.randrange(1, 20), 300 - at)
        equal(bench.run(slave, steps, at, 2), wanted[at:at + steps])
        at += steps
        states[at] = slave.getFMUstate()
        at = numbers.choice(list(states))
        slave.setFMUstate(states[at])
        equal(bench.y(slave, 2), wanted[at - 1] if at else [0.0, 0.0])
    other.setFMUstate(other.deSerializeFMUstate(slave.serializeFMUstate(states[at])))
    equal(bench.run(other, 300 - at, at, 2), wanted[at:])


def test_late_rows_do_not_change_a_repeated_step(bench):
    """A row that arrived after a step does not change the repetition of that step."""
    file = bench.file("time,a\n0,1\n")
    slave = bench.start(file=file, column1="a")
    state = slave.getFMUstate()
    equal(bench.run(slave, 3), [1.0, 1.0, 1.0])
    with open(file, "a", encoding="utf-8") as more:
        more.write("0.015,2\n0.04,3\n")
    slave.setFMUstate(state)
    equal(bench.run(slave, 5), [1.0, 1.0, 1.0, 3.0, 3.0])
    slave.setFMUstate(state)
    equal(bench.run(slave, 5), [1.0, 1.0, 1.0, 3.0, 3.0])


# ---- FIFOs ----


@contextmanager
def writer(path):
    """The writing end; a reader must exist."""
    descriptor = os.open(path, os.O_WRONLY | os.O_NONBLOCK)
    try:
        yield lambda text: os.write(descriptor, text.encode())
    finally:
        os.close(descriptor)


def test_fifo(bench):
    """No step waits: without a writer, without a header, within a row, after the writer has closed."""
    path = bench.fifo()
    slave = bench.start(file=path, column1="a", initial1=9)
    equal(bench.run(slave, 1), [9.0])
    with writer(path) as write:
        write("time,a\n0.01,1\n0.0")
        equal(bench.run(slave, 1, 1), [1.0])
        write("3,2\n0.05,3\n")
        equal(bench.run(slave, 1, 2), [2.0])
        equal(bench.run(slave, 1, 3), [2.0])
    equal(bench.run(slave, 2, 4), [3.0, 3.0])
    with writer(path) as write:
        write("0.07,4\n")
        equal(bench.run(slave, 1, 6), [4.0])


def test_fifo_rollback(bench):
    path = bench.fifo()
    slave = bench.start(file=path, column1="a")
    with writer(path) as write:
        write("time,a\n0.01,1\n0.02,2\n")
        state = slave.getFMUstate()
        equal(bench.run(slave, 3), [1.0, 2.0, 2.0])
        slave.setFMUstate(state)
        write("0.025,3\n")
        equal(bench.run(slave, 4), [1.0, 2.0, 2.0, 3.0])


def feed(bench, slave, write, steps, forget):
    """`steps` steps, each with a row of 1 kB before it; y1 after each."""
    values = []
    for i in range(steps):
        write(f"{(i + 1) * STEP_S},{i},{'0' * 1000}\n")
        slave.doStep(i * STEP_S, STEP_S, fmi2.fmi2True if forget else fmi2.fmi2False)
        values.append(bench.y(slave))
    return values


def test_fifo_rows_are_dropped_after_final_steps(bench):
    """The values are the same. A state whose rows are dropped is refused; a later one works."""
    path = bench.fifo()
    slave = bench.start(file=path, column1="a")
    early = slave.getFMUstate()
    with writer(path) as write:
        write("time,a,ballast\n")
        equal(feed(bench, slave, write, 300, True), [float(i) for i in range(300)])
        late = slave.getFMUstate()
        slave.setFMUstate(early)
        bench.expect_refused(lambda: slave.doStep(0.0, STEP_S), "noSetFMUStatePriorToCurrentPoint", path)
        slave.setFMUstate(late)
        write("3.01,17,0\n")
        equal(bench.run(slave, 1, 300), [17.0])


def test_fifo_rows_are_kept_after_steps_that_are_not_final(bench):
    path = bench.fifo()
    slave = bench.start(file=path, column1="a")
    early = slave.getFMUstate()
    with writer(path) as write:
        write("time,a,ballast\n")
        feed(bench, slave, write, 300, False)
    slave.setFMUstate(early)
    equal(bench.run(slave, 300), [float(i) for i in range(300)])


def test_fifo_of_another_instance(bench):
    """A state needs the rows of its instance. In another instance the step fails with a message."""
    path = bench.fifo()
    slave = bench.start(file=path, column1="a")
    with writer(path) as write:
        write("time,a\n0,1\n")
        bench.run(slave, 1)
        other = bench.fmu.instantiate()
        other.setFMUstate(other.deSerializeFMUstate(slave.serializeFMUstate(slave.getFMUstate())))
        bench.expect_refused(lambda: other.doStep(STEP_S, STEP_S), "row 1", path)


# ---- errors ----


def refused_at_the_start(bench, *words, **values):
    slave = bench.instance(**values)
    slave.enterInitializationMode()
    bench.expect_refused(slave.exitInitializationMode, *words)
    return slave


def test_no_file(bench):
    refused_at_the_start(bench, "parameter file", "measured.csv")
    refused_at_the_start(bench, "nothing.csv", "No such file", file=bench.folder / "nothing.csv")
    refused_at_the_start(bench, bench.folder, "FIFO", file=bench.folder)
    refused_at_the_start(bench, "data.csv", "first line", "columns", file=bench.file(""))


def test_the_file_may_be_set_again(bench):
    slave = refused_at_the_start(bench, "nothing.csv", "No such file", file=bench.folder / "nothing.csv", column1="a")
    bench.set(slave, file=bench.file("time,a\n0,1\n"))
    slave.exitInitializationMode()
    equal(bench.run(slave, 1), [1.0])


def test_no_column(bench):
    file = bench.file("time,a,b,b\n0,1,2,3\n")
    refused_at_the_start(bench, file, 'column "c"', "time,a,b", file=file, column1="a", column2="c")
    refused_at_the_start(bench, file, 'column "t"', "time,a,b", file=file, time_column="t")
    refused_at_the_start(bench, file, 'column "b"', file=file, column1="b")


def test_bad_rows(bench):
    """The step that reads a bad row fails with its line, also if the step is repeated."""
    head = "time,a\n0,1\n"
    for bad, line, *words in (
            ("0.01,x\n", 3, 'column "a"', '"x"', "12.5"), ("0.01,0x10\n", 3, "0x10"), ("0.01,nan\n", 3, "nan"),
            ("0.01,1e999\n", 3, "1e999"), ("0.01,1 2\n", 3, '"1 2"'), ("soon,1\n", 3, 'column "time"', '"soon"'),
            ("\n0.01,\"1\n", 4, '"1'), ("0.01," + 70 * "1" + "\n", 3, "1111"), (",1\n", 3, 'column "time"'),
            ("0.01\n", 3, "1 cells", "2 columns"), ("0.01,1,2\n", 3, "3 cells"),
            ("0.01,1\n0.01,2\n", 4, "time 0.01"), ("-1,1\n", 3, "time -1 s", " 0 s")):
        file = bench.file(head)
        slave = bench.start(file=file, column1="a")
        state = slave.getFMUstate()
        bench.file(head + bad)
        for _ in range(2):
            bench.expect_refused(lambda: bench.run(slave, 1), file, f"line {line}", *words)
            bench.expect_refused(lambda: bench.run(slave, 1), "failed")
            slave.setFMUstate(state)


def test_a_bad_number_in_an_unused_column(bench):
    file = bench.file("time,a,b\n0,1,x\n0.01,2,\n")
    equal(bench.run(bench.start(file=file, column1="a"), 1), [2.0])


def test_a_line_without_end(bench):
    file = bench.file("time,a\n" + 70000 * "1")
    refused_at_the_start(bench, file, "line 2", "65536 bytes", file=file, column1="a")


def test_formats_in_a_text_are_replaced(bench):
    slave = bench.instance(file=bench.file("time,a\n0,%s%n#r1#\n"), column1="a")
    slave.enterInitializationMode()
    bench.expect_refused(slave.exitInitializationMode, '"?s?n?r1?"')


def test_texts_that_are_too_long(bench):
    slave = bench.instance()
    bench.expect_refused(lambda: bench.set(slave, file=512 * "x"), "fmi2SetString", "511 bytes")
    bench.set(slave, file=511 * "x")


def test_parameters_are_fixed_while_stepping(bench):
    slave = bench.start(file=bench.file("time,a\n0,1\n"), column1="a")
    bench.expect_refused(lambda: bench.set(slave, column1="time"), "fixed parameter")
    bench.expect_refused(lambda: slave.setString([99], ["x"]), "value reference 99")
    bench.expect_refused(lambda: slave.getString([99]), "value reference 99")


# ---- all of them ----


def run_one(fmu, name, test):
    """True if it passed."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            note = test(Bench(fmu, folder))
            print(f"ok      {name}" + (f": {note}" if note else ""))
            return True
        except Exception:
            print(f"FAILED  {name}\n{traceback.format_exc()}{' '.join(fmu.messages[-1:])}")
            return False


def main():
    faulthandler.enable()
    if len(sys.argv) not in (2, 3) or sys.argv[2:] not in ([], ["--write-reference"]):
        sys.exit(__doc__)
    tests = [(name, value) for name, value in globals().items() if name.startswith("test_")]
    with tempfile.TemporaryDirectory() as folder:
        fmu = Fmu(Path(sys.argv[1]), folder)
        failed = sum(not run_one(fmu, name, test) for name, test in tests)
    print(f"{len(tests)} tests, {failed} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())

#!/usr/bin/env python3
"""The HTML report in a browser: its numbers are those of `--json`, its plots are drawn, and it loads nothing.

Names are shown as text, also with HTML in them. The tests leave pictures of the pages in report/ of the build folder."""
import json
import math
import os
import re
import resource
import shutil
import signal
import sqlite3
import subprocess
import time
import zlib
from contextlib import closing

from browser import Browser
from twinlock_test import (BUILD, PROGRAM, SOURCE, Skip, at_least, at_most, edited_config, expect, expect_line, finish, main, read_config,
                           read_table, run, run_well, scratch, start, write_config)

LOCK = SOURCE / "config" / "motor" / "lock.json"
CYLINDER = SOURCE / "config" / "cylinder" / "lock.json"
PICTURES = BUILD / "report"
HOSTILE = "</script><script>window.hacked = 1</script><img src=x onerror=\"window.hacked = 2\"><!-- '&\\ {{data}} \u017d"
BAD_USAGE, BAD_DATA, TRY_AGAIN = 2, 65, 75
STEPS = 1401

# Colours of page.css: paper and light, and dark.
LIGHT = {"simulated": (0, 103, 165), "measured": (232, 163, 61), "difference": (0, 122, 94)}
DARK = {"simulated": (90, 180, 240), "measured": (185, 119, 42), "difference": (63, 199, 159)}

# The pixels of a colour on the lower canvas of each plot, which has the curves: number, and bounds as fractions of the canvas.
PIXELS = """((red, green, blue) => Array.from(document.querySelectorAll('.plot'), (plot) => {
    const canvas = plot.querySelector('canvas');
    const {width, height} = canvas;
    const bytes = canvas.getContext('2d').getImageData(0, 0, width, height).data;
    let count = 0, left = width, right = 0, top = height, bottom = 0;
    for (let i = 0; i < bytes.length; i += 4) {
        if (Math.abs(bytes[i] - red) + Math.abs(bytes[i + 1] - green) + Math.abs(bytes[i + 2] - blue) < 24
            && bytes[i + 3] > 60) {
            const x = (i / 4) % width, y = Math.floor(i / 4 / width);
            count++;
            left = Math.min(left, x); right = Math.max(right, x);
            top = Math.min(top, y); bottom = Math.max(bottom, y);
        }
    }
    return {count, left: left / width, right: right / width, top: top / height, bottom: bottom / height};
}))"""


# ---- pages ----

def report(*args):
    """(path of the page, standard output)."""
    path = scratch() / "report.html"
    out = run_well([*args, "--report", path])
    expect([entry.name for entry in path.parent.iterdir()] == [path.name], f"{list(path.parent.iterdir())}")
    return path, out


def recorded(*statements):
    """The page of a recorded run that is changed by SQL statements, each a text or (text, values)."""
    database = scratch() / "run.db"
    run_well(["replay", LOCK, "--db", database])
    with closing(sqlite3.connect(database)) as connection, connection:
        for statement in statements:
            connection.execute(*((statement,) if isinstance(statement, str) else statement))
    return report("show", database)[0]


def data_of(path):
    """The curves in a page."""
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', path.read_text("utf-8"), re.S)
    return json.loads(found[1])


def picture(browser, name):
    PICTURES.mkdir(exist_ok=True)
    path = PICTURES / f"{name}.png"
    browser.picture(path)
    at_least(path.stat().st_size, 20_000, f"{path.name}, bytes")


def expect_quiet(browser, path):
    """No error, no message, no dialogue, and no request but for the page itself."""
    said = browser.happened("Runtime.exceptionThrown", "Runtime.consoleAPICalled", "Log.entryAdded",
                            "Page.javascriptDialogOpening")
    expect(not said, f"messages of the page: {said}")
    requests = [event["request"]["url"] for event in browser.happened("Network.requestWillBeSent")]
    expect(requests == [path.as_uri()], f"requests: {requests}")


def figures(browser):
    """{key: value} of the figures on the page; None for an empty one."""
    pairs = browser.ask("Array.from(document.querySelectorAll('data[data-key]'), (one) => [one.dataset.key, one.value])")
    return {key: float(value) if value else None for key, value in pairs}


def coloured(browser, colour):
    red, green, blue = colour
    return browser.ask(f"{PIXELS}({red}, {green}, {blue})")


def expect_curve(pixels, what):
    """A curve spans the plot and stays inside it."""
    expect(pixels["count"] > 300 and pixels["left"] < 0.15 and pixels["right"] > 0.9, f"{what}: {pixels}")
    expect(pixels["top"] >= 0 and pixels["bottom"] < 0.85, f"{what} crosses the axis: {pixels}")


def expect_plots(browser, colours):
    """The five plots of config/motor/lock.json: y and ŷ, Δy, u and û, Δu, effort."""
    simulated, measured, difference = (coloured(browser, colours[name]) for name in ("simulated", "measured", "difference"))
    expect(len(simulated) == 5, f"{len(simulated)} plots")
    for pixels, name, plot in ((simulated, "y", 0), (measured, "\u0177", 0), (difference, "\u0394y", 1),
                               (simulated, "u", 2), (difference, "\u0394u", 3), (simulated, "executions", 4)):
        expect_curve(pixels[plot], name)
    for plot in (0, 2, 4):
        expect(difference[plot]["count"] == 0, f"plot {plot} has a deviation")
    expect(simulated[0]["bottom"] - simulated[0]["top"] > 0.4, f"y does not fill its plot: {simulated[0]}")


def x_labels(browser):
    return browser.ask("""Array.from(document.querySelectorAll('.plot'), (plot) => Array.from(
        plot.querySelectorAll('.dygraph-axis-label-x'), (label) => label.textContent).join(' '))""")


def place_of(browser, plot):
    """Scrolls a plot into the window. Returns its (left, top, width, height) there."""
    return browser.ask(f"""(() => {{
        const plot = document.querySelectorAll('.plot')[{plot}];
        plot.scrollIntoView({{block: 'center'}});
        const {{left, top, width, height}} = plot.getBoundingClientRect();
        return [left, top, width, height];
    }})()""")


# ---- content ----

def test_a_replay():
    path, out = report("replay", LOCK, "--json")
    told = json.loads(out)
    with Browser() as browser:
        browser.open(path)
        picture(browser, "lock")
        expect_quiet(browser, path)
        expect_plots(browser, LIGHT)
        shown = figures(browser)
        text = browser.ask("document.body.innerText")
    for kind in ("match", "adjust"):
        for index, numbers in enumerate(told[kind].values()):
            for key, value in numbers.items():
                if key != "unit":
                    found = shown[f"{kind}.{index}.{key}"]
                    # JSON has 15 digits if these are near enough to the number
                    expect(math.isclose(found, value, rel_tol=1e-14), f"{kind} {key}: {found!r}, not {value!r}")
    for index, entry in enumerate([*told["ledger"]["components"].values(), told["ledger"]["total"]]):
        for key in ("executions", "plain"):
            expect(shown[f"ledger.{index}.{key}"] == entry[key], f"{key} of component {index}: {shown}")
    for key in ("steps", "evaluations", "optimised_steps"):
        expect(shown[key] == told[key], f"{key}: {shown}")
    outcomes = {key: value for key, value in told["outcomes"].items() if value}
    expect({key[9:]: value for key, value in shown.items() if key.startswith("outcomes.")} == outcomes, f"{shown}")
    for parts in ("motor bench, locked", "recording.csv", "secant", "TP = 1, lag", "end of recording", "rad/s", "N.m.s/rad", "time in s",
                  "replay|clock", "MIT licence"):
        expect_line(text, parts)


def test_the_curves_are_those_of_csv():
    table = scratch() / "steps.csv"
    path, _ = report("replay", LOCK, "--csv", table)
    rows, data = read_table(table), data_of(path)
    match, adjust = data["match"][0], data["adjust"][0]
    pairs = ((match["simulated"], rows["motor.omega"]), (match["measured"], rows["plant.omega"]),
             (adjust["applied"], rows["motor.d"]), (adjust["nominal"], rows["motor.d nominal"]),
             (data["evaluations"], rows["evaluations"]))
    for drawn, written in pairs:
        expect(len(drawn) == len(written) == STEPS, f"{len(drawn)} points")
        expect(drawn == [float(f"{value:.9g}") for value in written], "a curve differs from --csv")
    expect(sum(data["executions"]) == 4204 and data["width"] == 1, "executions or width")


def test_a_free_run():
    path, _ = report("replay", SOURCE / "config" / "motor" / "free.json")
    with Browser() as browser:
        browser.open(path)
        picture(browser, "free")
        expect_quiet(browser, path)
        simulated, measured = (coloured(browser, LIGHT[name]) for name in ("simulated", "measured"))
        expect(len(simulated) == 3, f"{len(simulated)} plots")
        expect_curve(simulated[0], "y")
        expect_curve(measured[0], "\u0177")
        expect_line(browser.ask("document.body.innerText"), "not synchronised")


def test_zoom_and_cursor():
    path, _ = report("replay", LOCK)
    y = data_of(path)["match"][0]["simulated"]
    with Browser() as browser:
        browser.open(path)
        whole = x_labels(browser)
        left, top, width, height = place_of(browser, 0)
        browser.move(left + width / 2, top + height / 2)
        shown = browser.ask("Array.from(document.querySelectorAll('figcaption'), (one) => one.innerText)")
        times = [float(re.search(r"t = ([\d.]+) s", text)[1]) for text in shown]
        expect(max(times) - min(times) < 0.011 and 5 < times[0] < 9, f"cursor at {times}")
        value = float(re.search(r"y simulated ([\d.]+)", shown[0])[1])
        expect(math.isclose(value, y[round(times[0] * 100) - 1], rel_tol=1e-5), f"y at {times[0]} s: {value}")
        browser.drag((left + width * 0.7, top + height / 2), (left + width * 0.9, top + height / 2))
        zoomed = x_labels(browser)
        expect(len(set(zoomed)) == 1 and zoomed[0] != whole[0], f"zoomed: {zoomed}")
        browser.double_click(left + width / 2, top + height / 2)
        expect(x_labels(browser) == whole, f"double click: {x_labels(browser)}")
        expect_quiet(browser, path)


def test_dark_and_narrow():
    path, _ = report("replay", LOCK)
    with Browser() as browser:
        browser.open(path, dark=True)
        picture(browser, "dark")
        expect_plots(browser, DARK)
        browser.open(path, width=390)
        picture(browser, "narrow")
        widths = browser.ask("[document.documentElement.scrollWidth, innerWidth]")
        expect(widths[0] <= widths[1], f"the page is wider than the window: {widths}")
        expect_quiet(browser, path)


# ---- paper ----

def strokes(path):
    """The number of lines of each colour in each plot of a PDF: [{'0 .4039 .6471': 1401}, …]. The browser draws each canvas
    again for paper, as one deflated stream; RG sets a colour, l draws a line."""
    plots = []
    for stream in re.findall(rb"stream\r?\n(.*?)\r?\nendstream", path.read_bytes(), re.S):
        try:
            commands = zlib.decompress(stream).decode("ascii").split("\n")
        except (zlib.error, UnicodeDecodeError):
            continue  # a font, a picture
        lines, colour = {}, None
        for command in commands:
            colour = command.split(" RG")[0] if " RG" in command else colour
            if command.endswith(" l"):
                lines[colour] = lines.get(colour, 0) + 1
        if sum(lines.values()) > 100:
            plots.append(lines)
    return plots


def on_paper(colour):
    return " ".join(f"{part / 255:.4f}".lstrip("0").rstrip("0").rstrip(".") or "0" for part in colour)


def test_paper():
    path, _ = report("replay", LOCK)
    with Browser() as browser:
        browser.open(path, dark=True)
        before = x_labels(browser)
        PICTURES.mkdir(exist_ok=True)
        browser.print(PICTURES / "lock.pdf")
        plots = strokes(PICTURES / "lock.pdf")
        expect(len(plots) == 5, f"{len(plots)} plots on paper")
        for plot, names in zip(plots, (("simulated", "measured"), ("difference",), ("simulated",), ("difference",), ("simulated",))):
            for name in names:
                expect(plot.get(on_paper(LIGHT[name]), 0) >= STEPS - 1, f"{name}: {plot}")
        expect(x_labels(browser) == before, "printing changes the page on the screen")
        expect_plots(browser, DARK)
        browser.ask("dispatchEvent(new Event('beforeprint'))")
        expect_plots(browser, LIGHT)
        widths = browser.ask("Array.from(document.querySelectorAll('.plot'), (plot) => plot.offsetWidth)")
        expect(set(widths) == {670}, f"widths on paper: {widths}")
        browser.call("Emulation.setEmulatedMedia", media="print")
        shown = browser.ask("Array.from(document.querySelectorAll('.plot canvas'), (one) => getComputedStyle(one).display)")
        expect("none" not in shown[0::2] and set(shown[1::2]) == {"none"}, f"the upper canvas hides the lower: {shown}")


# ---- recorded runs ----

def test_a_recorded_run_has_the_same_curves():
    database = scratch() / "run.db"
    direct, _ = report("replay", LOCK, "--db", database)
    shown = data_of(report("show", database)[0])
    expect(shown == data_of(direct), "the curves of replay and show differ")


def test_a_live_run():
    """The database of a replay, changed to that of a live run with gaps, bad values, an event and a Boolean."""
    path = recorded(
        "UPDATE runs SET verb = 'run', started = '2026-11-21T10:00:00.000Z'",
        "UPDATE steps SET used_ns = 1000000 + step * 1000", "UPDATE steps SET used_ns = 11000000 WHERE step = 50",
        "UPDATE signals SET type = 'Boolean' WHERE kind = 'adjust'",
        "UPDATE adjustments SET applied = (step / 100) % 2, nominal = 0",
        "UPDATE outputs SET quality = 4 WHERE step BETWEEN 300 AND 360",
        *(f"DELETE FROM {table} WHERE step BETWEEN 800 AND 900" for table in ("steps", "outputs", "adjustments")),
        "INSERT INTO events (run, at, tick, severity, source, text) VALUES"
        " (1, '2026-11-21T10:00:03.000Z', 300, 1, 'plant', 'plant.omega: no link, since 25:99 UTC')")
    data = data_of(path)
    measured, y = data["match"][0]["measured"], data["match"][0]["simulated"]
    expect(measured[300:361] == [None] * 61 and None not in measured[:300], "bad values are drawn")
    expect(y[800:901] == [None] * 101 and None not in y[:800], "a gap is drawn over")
    expect(data["match"][0]["bad"] == [[300, 360, 16]], f"{data['match'][0]['bad']}")
    with Browser() as browser:
        browser.call("Emulation.setTimezoneOverride", timezoneId="Asia/Kolkata")
        browser.open(path)
        local = browser.ask("document.body.innerText")
        browser.call("Emulation.setTimezoneOverride", timezoneId="UTC")
        browser.open(path)
        picture(browser, "live")
        expect_quiet(browser, path)
        text = browser.ask("document.body.innerText")
        labels = browser.ask("Array.from(document.querySelectorAll('.dygraph-axis-label-y'), (one) => one.textContent)")
        shown = figures(browser)
        warnings = coloured(browser, (179, 92, 0))
        bad, gaps = coloured(browser, (190, 60, 40)), coloured(browser, (110, 120, 130))
    for parts in ("2026-11-21 10:00:00 UTC", "plant.omega|no link", "budget|6 ms", "macro step|10 ms", "not all", "longest|11 ms|10 ms", "10:00:04",
                  "grey|database", "hatched|no link"):
        expect_line(text, parts)
    for parts in ("2026-11-21 15:30:00 GMT+5:30", "2026-11-21 15:30:03 GMT+5:30|no link", "15:30:04"):
        expect_line(local, parts)
    expect("true" in labels and "false" in labels, f"{labels}")
    expect(shown["late"] == 1, f"late: {shown}")
    expect(bad[0]["count"] > 100 and 0.2 < bad[0]["left"] < bad[0]["right"] < 0.4 and bad[2]["count"] == 0, f"{bad}")
    expect(all(plot["count"] > 100 for plot in gaps), f"gaps: {gaps}")
    expect(len(warnings) == 6 and all(plot["count"] > 20 for plot in warnings), f"marks of the event: {warnings}")


def test_since():
    database = scratch() / "run.db"
    run_well(["replay", LOCK, "--db", database])
    data = data_of(report("show", database, "--since", "2s")[0])
    expect(data["first"] == STEPS - 200 and data["steps"] == 200, f"{data['first']}, {data['steps']}")


def test_a_run_without_steps():
    path = recorded("DELETE FROM steps", "DELETE FROM outputs", "DELETE FROM adjustments")
    with Browser() as browser:
        browser.open(path)
        expect_quiet(browser, path)
        expect_line(browser.ask("document.body.innerText"), "no steps")


def test_a_configuration_of_a_newer_program():
    """Tolerance and solver are unknown; the rest is shown."""
    data = data_of(recorded("UPDATE configurations SET text = '{\"twinlock\": 99}'"))
    expect(data["match"][0]["tolerance"] == 0 and len(data["match"][0]["simulated"]) == STEPS, "tolerance or curves")


# ---- names ----

def expect_inert(browser, path):
    expect_quiet(browser, path)
    expect(browser.ask("window.hacked") is None, "a name was run")
    expect(browser.ask("document.scripts.length") == 3, "a name became a script")
    expect(browser.ask("document.querySelectorAll('img, .plot i, .plot b').length") == 0, "a name became an element")


def test_hostile_names():
    document = read_config(edited_config(LOCK))
    document["name"] = HOSTILE
    path, _ = report("replay", write_config(document))
    with Browser() as browser:
        browser.open(path)
        expect_inert(browser, path)
        expect(browser.ask("document.querySelector('h1').textContent") == HOSTILE, "another name")
        expect(HOSTILE in browser.ask("document.title"), "another title")
        expect_plots(browser, LIGHT)


def test_hostile_database():
    values = {"hostile": HOSTILE, "unit": "<i>rad/s</i><img src=x onerror='window.hacked = 3'>"}
    path = recorded(("UPDATE runs SET name = :hostile, version = :hostile, ended_reason = :hostile", values),
                    ("UPDATE signals SET name = name || :hostile, unit = :unit", values),
                    ("UPDATE signals SET compared_with = :hostile WHERE kind = 'match'", values),
                    ("UPDATE components SET name = :hostile", values),
                    ("INSERT INTO events (run, at, tick, severity, source, text)"
                     " VALUES (1, '2026-11-22T10:00:00.000Z', 5, :hostile, :hostile, :hostile)", values))
    with Browser() as browser:
        browser.open(path)
        picture(browser, "hostile")
        expect_inert(browser, path)
        left, top, width, height = place_of(browser, 0)
        browser.move(left + width / 2, top + height / 2)
        expect_inert(browser, path)
        expect(HOSTILE in browser.ask("document.querySelector('figcaption').textContent"), "another name")
        expect(values["unit"] in browser.ask("document.querySelector('.dygraph-ylabel').textContent"), "a unit")
        expect_plots(browser, LIGHT)


def test_the_policy_holds():
    """If HTML of a name got into the page, the Content Security Policy would block its scripts and requests."""
    path, _ = report("replay", LOCK)
    slipped = ("<script>window.hacked = 1</script><img src='https://plant.example/x.png' onerror='window.hacked = 2'>"
               "<script src='https://plant.example/x.js'></script>")
    page = path.read_text(encoding="utf-8")
    path.write_text(page.replace("<main>", "<main>" + slipped), encoding="utf-8")
    with Browser() as browser:
        browser.open(path)
        expect(browser.ask("document.scripts.length") == 5, "no script was inserted")
        expect(browser.ask("window.hacked") is None, "an inserted script was run")
        refused = [event["entry"]["text"] for event in browser.happened("Log.entryAdded")]
        expect(len(refused) >= 3 and all("Content Security Policy" in text for text in refused), f"{refused}")
        expect(not browser.happened("Network.responseReceived")[1:], "something was loaded")
        expect_plots(browser, LIGHT)


# ---- long runs ----

def test_a_long_run_is_thinned():
    """100000 steps with one outlier: the page is small and has the outlier."""
    recording, table = scratch() / "long.csv", scratch() / "steps.csv"
    count = 100_000
    with open(recording, "w", encoding="utf-8") as file:
        file.write("t,M_brake,omega\n")
        for i in range(count):
            file.write(f"{i / 100:.2f},1,{150 if i == 77_777 else 62 + math.sin(i / 300):.6f}\n")
    config = edited_config("motor/free.json", {"duration_s": None})
    path, _ = report("replay", config, "--recording", recording, "--csv", table)
    rows, match = read_table(table), data_of(path)["match"][0]
    for drawn, written in ((match["simulated"], rows["motor.omega"]), (match["measured"], rows["plant.omega"])):
        for extreme in (max, min):
            expect(extreme(drawn) == float(f"{extreme(written):.9g}"), f"{extreme.__name__}: {extreme(drawn)}")
    at_most(path.stat().st_size, 2_000_000, "page of 100000 steps, bytes")
    with Browser() as browser:
        begun = time.monotonic()
        browser.open(path)
        print(f"    drawn after {time.monotonic() - begun:.2f} s")
        picture(browser, "long")
        expect_quiet(browser, path)
        shown = figures(browser)
        expect(shown["width"] == 16, f"width: {shown['width']}")
        expect_line(browser.ask("document.body.innerText"), "16 steps|extreme")
        expect(len(coloured(browser, LIGHT["difference"])) == 3, "plots")


# ---- files ----

def expect_refused(args, code, parts):
    found, _, err = run(args)
    expect(found == code, f"{args}: {found}, {err}")
    expect_line(err, parts)


def test_paths_that_cannot_be_written():
    folder, database = scratch(), scratch() / "run.db"
    run_well(["replay", LOCK, "--db", database])
    fifo, dangling = folder / "fifo", folder / "link"
    os.mkfifo(fifo)
    dangling.symlink_to("absent")
    for args in (["replay", LOCK], ["show", database]):
        expect_refused([*args, "--report", folder / "absent" / "x.html"], TRY_AGAIN, "x.html|No such file")
        expect_refused([*args, "--report", folder], BAD_DATA, f"error|{folder}|file")
        expect_refused([*args, "--report", fifo], BAD_DATA, f"error|{fifo}|file")
        expect_refused([*args, "--report", dangling], BAD_DATA, f"error|{dangling}|symbolic link")
        expect_refused([*args, "--report", ""], BAD_USAGE, "error|empty|report.html")
    expect(sorted(path.name for path in folder.iterdir()) == ["fifo", "link"], f"{list(folder.iterdir())}")
    for other in ("--json", "--csv=steps"):
        expect_refused(["show", database, "--report", folder / "x.html", other], BAD_USAGE, "twinlock show|--json|--csv|--report")


def test_nothing_of_the_users_is_overwritten():
    config, folder = edited_config(LOCK), scratch()
    recording = folder / "plant.csv"
    recording.write_bytes((SOURCE / "config" / "motor" / "recording.csv").read_bytes())
    database, link = folder / "run.db", folder / "link.html"
    run_well(["replay", config, "--db", database])
    link.symlink_to(database)
    kept = {path: path.read_bytes() for path in (config, recording, database)}
    replay = ["replay", config, "--recording", recording]
    for target in (config, recording):
        expect_refused([*replay, "--report", target], BAD_USAGE, f"--report|{target}|overwrite")
    for option in ("--db", "--csv"):
        expect_refused([*replay, option, folder / "new", "--report", folder / "new"], BAD_USAGE, f"--report|{folder / 'new'}|overwrite")
    for target in (database, link):
        expect_refused([*replay, "--db", database, "--report", target], BAD_USAGE, f"--report|{target}|overwrite|{database}")
        expect_refused(["show", database, "--report", target], BAD_USAGE, f"--report|{target}|overwrite|database")
    for path, content in kept.items():
        expect(path.read_bytes() == content, f"{path.name} was overwritten")


def limited_to(size):
    """A function for the child before the program: writing more than `size` bytes into a file fails, as on a full disk."""
    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    return limit


def test_a_full_disk_of_replay():
    """On a tmpfs of 256 kB. A limit of the file size would hit the memory shared with the FMUs, which is larger than the page."""
    small = ["unshare", "-Urm", "sh", "-c", 'mount -t tmpfs -o size=256k none "$0" && printf yesterday > "$0/report.html" && "$@"; code=$?; '
             'ls -A "$0"; cat "$0/report.html"; exit $code', str(scratch())]
    if shutil.which(small[0]) is None or subprocess.run([*small, "true"], capture_output=True, check=False).returncode != 0:
        raise Skip("mounting a tmpfs is not permitted here")
    code, out, err = run([*small[1:], PROGRAM, "replay", CYLINDER, "--report", f"{small[-1]}/report.html"], executable=small[0])
    expect(code == TRY_AGAIN, f"{code}: {err}")
    expect_line(err, "error|report.html|No space left on device")
    expect(out.endswith("\nreport.html\nyesterday"), f"the old page is lost, or another file is left: {out}")


def test_a_full_disk():
    """All bytes of the page but the last one fit."""
    path, database = scratch() / "report.html", scratch() / "run.db"
    run_well(["replay", CYLINDER, "--db", database])
    run_well(["show", database, "--report", path])
    limit = limited_to(path.stat().st_size - 1)
    path.write_text("the one of yesterday", encoding="utf-8")
    code, _, err = run(["show", database, "--report", path], preexec_fn=limit, restore_signals=False)
    expect(code == TRY_AGAIN, f"{code}: {err}")
    expect_line(err, f"error|{path}|File too large")
    expect(path.read_text(encoding="utf-8") == "the one of yesterday", "the old page is lost")
    expect(len(list(path.parent.iterdir())) == 1, f"{list(path.parent.iterdir())}")


def begin_realtime(path):
    process = start(["replay", LOCK, "--realtime", "--report", path])
    until = time.monotonic() + 30
    while not list(path.parent.glob("report.html.new-*")):
        expect(time.monotonic() < until and process.poll() is None, "no file was begun")
        time.sleep(0.01)
    time.sleep(0.5)
    return process


def test_an_interrupted_replay_writes_its_steps():
    path = scratch() / "report.html"
    process = begin_realtime(path)
    process.send_signal(signal.SIGINT)
    finish(process)
    expect(0 < data_of(path)["steps"] < STEPS, "steps")
    expect_line(path.read_text(encoding="utf-8"), "SIGINT")
    expect([entry.name for entry in path.parent.iterdir()] == [path.name], f"{list(path.parent.iterdir())}")


def test_a_killed_replay_leaves_the_old_page():
    path = scratch() / "report.html"
    path.write_text("the one of yesterday", encoding="utf-8")
    process = begin_realtime(path)
    process.kill()
    process.communicate()
    expect(path.read_text(encoding="utf-8") == "the one of yesterday", "the old page is lost")


main()

"""Reads facts from the output of a command, by which two builds are compared; for script/compare.

A fact has a kind (KINDS, see script/compare), a place within the output, and lines. Numbers are compared as text, so that all
bits count. Times of day, durations and the version are left out, or replaced by "*". Names of columns, tables and JSON keys
are replaced by canonical ones (NAMES).
"""
import contextlib
import functools
import hashlib
import html
import json
import re
import shutil
import sqlite3
import tempfile
from collections import namedtuple
from pathlib import Path

from study import Trouble

KINDS = ("values", "codes", "words", "sizes")
ALLOWABLE = ("words", "sizes")

Fact = namedtuple("Fact", "kind place lines")

NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?!\w)", re.IGNORECASE)
VOLATILE = (
    (re.compile(r"\b\d{4}-\d\d-\d\d[ T]\d\d:\d\d:\d\d(\.\d+)?Z?"), "*"),
    (re.compile(r"\btwinlock \d+(\.\d+)+\S*"), "twinlock *"),
    (re.compile(r"(\btook +)\S+ s\b"), r"\1* s"),
    (re.compile(r'("wall_s":\s*)[^,\s]+'), r"\1*"),
)

# A renamed column or key gets an entry here, so that builds before and after can be compared, and digests stay the same.
NAMES = {"y": "simulated", "y_hat": "measured", "u": "applied", "u_hat": "nominal", "caught_up": "repeated", "unstored": "uncached",
         "delta": "difference", "error": "difference", "correction": "difference"}
NAME = re.compile(rf"(?<![^\W_])({'|'.join(sorted(NAMES, key=len, reverse=True))})(?![^\W_])")

# Values of the page of `check` that differ in each call: measured times, and what depends on them, such as the fastest method of
# rollback; the growth of the heap.
CHECK_TIMES = (
    (re.compile(r"\S+ (\u00b5s|ms|s) here: \S+ (%|cycles)"), r"* here: * \2"),
    (re.compile(r"\S+ \u00b5s (to save, step and restore; by its own state) \S+ \u00b5s"), r"* \1 *"),
    (re.compile(r"measured by \d+ free steps"), "measured by * free steps"),
    (re.compile(r"(?m)^          which moves .*\n.*\n|^          moves no matched output .*\n"), ""),
    (re.compile(r'(?m)^faster\n(?:  .* would take .*\n)+'), ""),
    (re.compile(r'"auto" keeps \w+'), '"auto" keeps *'),
    (re.compile(r'(?s)(?<="auto" keeps \*)(.*?)\nexecutions of an evaluation, .*?KiB: without[^\n]*'), r"\1"),
    (re.compile(r"tested at the start by \d+ executions"), "tested at the start by * executions"),
    (re.compile(r"(?:tested|looked at) \d+ times?, \S+ \u2026 \S+ s from the start"), "tested * times"),
    (re.compile(r"\b(same values in) \d+ steps?"), r"\1 * steps"),
    (re.compile(r"(?m)^(  states +).*"), r"\1*"),
)
WARNED_BY_TIME = re.compile(r"\S+ ms here\b")
NEEDS_HEAD = "  component "
# Also the names of builds from before 2026-11-28: mail, outbox, past, shadow.
SIZED = re.compile(r"  (memory|samples|record queue|checkpoint|resume|second twin|mail|outbox|past|shadow) ")

# Columns of the database that depend on the time of day or on the version, by table.
LEFT_OUT = {"runs": {"started", "ended", "committed", "version"}, "events": {"at"}, "beginnings": {"boot", "start_ns"},
            "learned": {"at", "sha256", "bytes"}}  # the bytes have padding
FMU_SUMS = {"beginnings": {"fmus"}}

# A digest covers these values that a run has read, computed and committed, by canonical names of tables and columns.
COMMITTED = {
    "samples": ("tick", "signal", "value", "quality", "stamp_ns"),
    "outputs": ("step", "signal", "simulated", "measured", "quality", "readings", "squares", "rejected"),
    "adjustments": ("step", "signal", "applied", "nominal"),
    "steps": ("step", "t_ns", "outcome", "stop", "J", "J_nominal", "evaluations", "executions", "predicted", "flags", "held"),
    "components": ("component", "plain", "predicted", "executions", "repeated", "uncached"),
}


def masked(text, patterns=VOLATILE):
    for pattern, stand_in in patterns:
        text = pattern.sub(stand_in, text)
    return text


@functools.cache
def canonical(name):
    return NAME.sub(lambda match: NAMES[match[1]], name)


# ---- texts ----

def words(place, text):
    return [Fact("words", place, masked(text).splitlines())]


def page(place, text):
    """A text for users: its numbers are values, the rest is words."""
    lines = masked(text).splitlines()
    return [Fact("values", f"{place}, numbers", [number for line in lines for number in NUMBER.findall(line)]),
            Fact("words", place, [NUMBER.sub("#", line) for line in lines])]


def checked(place, text):
    """The page of `check`. The column before a component's time, KiB, is a size."""
    kept, sizes, in_needs = [], [], False
    for line in masked(text, CHECK_TIMES).splitlines():
        if line.startswith("  sum "):
            in_needs = False
        if in_needs:
            *cells, size, _ = line.split()
            sizes.append(f"{cells[0]} {size}")
            line = "  " + " ".join(cells)
        if SIZED.match(line):
            sizes.append(line)
        elif not WARNED_BY_TIME.search(line):
            kept.append(line)
        in_needs = in_needs or line.startswith(NEEDS_HEAD)
    return [*page(place, "\n".join(kept)), Fact("sizes", f"{place}, memory", sizes)]


# ---- tables and objects ----

def table(place, text):
    """A CSV table: all cells are values, but for times of day."""
    head, *rows = masked(text, VOLATILE[:1]).splitlines() or [""]
    return [Fact("values", place, [canonical(head), *rows])]


def _leaves(value, path=""):
    """("path", leaf) of a JSON document, in its order."""
    if isinstance(value, (dict, list)):
        if not value:
            yield path, "empty"
        for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _leaves(inner, f"{path}.{key}" if path else str(key))
    else:
        yield path, value


def document(place, text):
    """A JSON object. Numbers are compared as text."""
    try:
        parsed = json.loads(text, parse_float=str, parse_int=str)
    except ValueError:
        return [Fact("values", place, text.splitlines())]
    facts, lines = [], []
    for path, leaf in _leaves(parsed):
        if path.endswith(".text"):
            facts += page(f"{place}, {path}", leaf)
        elif path != "wall_s" and not path.endswith(".version"):
            lines.append(f"{canonical(path)}: {masked(str(leaf), VOLATILE[:1])}")
    return [Fact("values", place, lines), *facts]


def report(place, text):
    """An HTML page: its `data` elements and the JSON of its curves are values, the rest is words."""
    figures = [f"{canonical(html.unescape(key))}: {value}"
               for key, value in re.findall(r'<data data-key="([^"]*)" value="([^"]*)"', text)]
    curves = re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.DOTALL)
    rest = text.replace(curves[0], "") if curves else text
    facts = document(f"{place}, curves", curves[1]) if curves else []
    rest = re.sub(r"<data [^>]*>[^<]*", "<data>", rest)
    return [Fact("values", f"{place}, figures", figures), *facts, *words(place, rest)]


# ---- databases ----

def _columns(connection, table):
    """{canonical name: name} of the columns of a table."""
    return {canonical(row[1]): row[1] for row in connection.execute(f'PRAGMA table_info("{table}")')}


def _rows(connection, table, columns, where=""):
    select = ", ".join(f'"{column}"' for column in columns)
    order = ", ".join(str(i + 1) for i in range(len(columns)))
    return connection.execute(f'SELECT {select} FROM "{table}" {where} ORDER BY {order}').fetchall()


def _table_facts(connection, place, table, left_out):
    columns, name = _columns(connection, table), canonical(table)
    chosen = [column for column in columns if column not in left_out]
    rows = _rows(connection, table, [columns[column] for column in chosen])
    if name != "events":
        return [Fact("values", f"{place}, {name}", [",".join(chosen), *(",".join(map(repr, row)) for row in rows)])]
    text = chosen.index("text")
    lines = [",".join(repr(cell) for i, cell in enumerate(row) if i != text) for row in rows]
    return [Fact("values", f"{place}, events", lines),
            *page(f"{place}, texts of events", "\n".join(str(row[text]) for row in rows))]


@contextlib.contextmanager
def _opened(path):
    """A connection to a copy, because a reader leaves files beside the database."""
    with tempfile.TemporaryDirectory() as folder:
        for part in path.parent.glob(f"{path.name}*"):
            shutil.copy(part, folder)
        with contextlib.closing(sqlite3.connect(Path(folder, path.name))) as connection:
            yield connection


def database(place, path, own_fmus):
    """All tables, row by row, and the schema. Floats are compared to the last bit."""
    try:
        with _opened(path) as connection:
            return _database(connection, place, own_fmus)
    except sqlite3.Error as error:
        return [Fact("values", place, [f"cannot be read: {error}"])]


def _database(connection, place, own_fmus):
    made = connection.execute("SELECT type, name, sql FROM sqlite_master ORDER BY type, name").fetchall()
    lines = [f"{kind} {canonical(name)}: {canonical(' '.join((sql or '').split()))}" for kind, name, sql in made]
    for pragma in ("application_id", "user_version", "journal_mode", "auto_vacuum", "page_size", "integrity_check"):
        lines.append(f"{pragma}: {connection.execute(f'PRAGMA {pragma}').fetchone()[0]}")
    facts = [Fact("words", f"{place}, schema", lines)]
    for kind, name, _ in made:
        if kind == "table" and not name.startswith("sqlite_"):
            left_out = LEFT_OUT.get(name, set()) | (FMU_SUMS.get(name, set()) if own_fmus else set())
            facts += _table_facts(connection, place, name, left_out)
    return facts


# ---- digests ----

def _digest(content):
    return hashlib.sha256(content).hexdigest()[:12]


def committed(path):
    """["table=digest"] of the first run of a database, for tables that have rows. All bits count."""
    found = []
    with _opened(path) as connection:
        names = [row[0] for row in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
        tables = {canonical(name): name for name in names}
        for name, wanted in COMMITTED.items():
            columns = _columns(connection, tables[name]) if name in tables else {}
            missing = [column for column in wanted if column not in columns]
            if missing:
                raise Trouble(f"{path.name}: {name} has no {', '.join(missing)}: add the new names to NAMES in "
                              "script/compare_facts.py")
            rows = _rows(connection, tables[name], [columns[column] for column in wanted], "WHERE run = 1")
            if rows:
                found.append(f"{name}={_digest(repr(rows).encode())}")
    return found


def recorded(path):
    """"name=digest" of a recording that an emulated plant has written."""
    return f"{path.name}={_digest(path.read_bytes())}"


# ---- differences ----

def _where(lines, other, i):
    """The place in line i at which two texts differ (for tables with the column's name), and both texts."""
    if i >= len(lines) or i >= len(other):
        return f"line {i + 1}", lines[i] if i < len(lines) else "nothing", other[i] if i < len(other) else "nothing"
    names, mine, theirs = lines[0].split(","), lines[i].split(","), other[i].split(",")
    if i > 0 and len(names) == len(mine) == len(theirs) > 1:
        column = next(k for k, cell in enumerate(mine) if cell != theirs[k])
        return f"line {i + 1}, {names[column]}", mine[column], theirs[column]
    return f"line {i + 1}", lines[i], other[i]


def _short(text):
    return text if len(text) <= 160 else text[:157] + "\u2026"


def difference(before, after):
    """None, or the first difference of two facts, and the number of differences."""
    a, b = before.lines, after.lines
    if a == b:
        return None
    count = sum(x != y for x, y in zip(a, b)) + abs(len(a) - len(b))
    first = next((i for i, (x, y) in enumerate(zip(a, b)) if x != y), min(len(a), len(b)))
    where, mine, theirs = _where(a, b, first)
    more = f" ({count} of {max(len(a), len(b))} lines)" if count > 1 else ""
    return f"{where}: {_short(mine)} \u2192 {_short(theirs)}{more}"


def differences(before, after):
    """[(kind, text)] of two lists of facts."""
    mine, theirs = {fact.place: fact for fact in before}, {fact.place: fact for fact in after}
    found = []
    for place in dict.fromkeys([*mine, *theirs]):
        fact = mine.get(place) or theirs.get(place)
        none = Fact(fact.kind, place, [])
        text = difference(mine.get(place, none), theirs.get(place, none))
        if text:
            found.append((fact.kind, f"{place}: {text}"))
    return found

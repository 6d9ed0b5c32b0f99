#!/usr/bin/env python3
"""The manual pages render; one has the verbs and options of the help, the other all keys of the schema."""
import copy
import gzip
import json
import re

import jsonschema

import debian
from twinlock_test import SOURCE, expect, main, run_well, scratch

debian.need("man")
ROOT = debian.unpacked(debian.make())
PAGE = ROOT / "usr/share/man/man1/twinlock.1.gz"
KEYS_PAGE = ROOT / "usr/share/man/man5/twinlock.json.5.gz"
SCHEMA = json.loads((SOURCE / "config/schema/twinlock-1.json").read_text(encoding="utf-8"))
# "--db FILE", "--run N|last", "--json": the parameter of an option is in capitals.
OPTION = r"--[a-z][a-z-]*(?: (?:[A-Z][A-Z0-9]*(?:\|[a-z]+)?)(?= |$))?"


def rendered(page=PAGE):
    """The page as plain text with 120 columns."""
    options = ["-P", "cat", "--no-hyphenation", "--no-justification"]
    text = debian.output_of("man", *options, "-l", page, env={"PATH": "/usr/bin:/bin", "MANWIDTH": "120",
                                                              "LC_ALL": "C.UTF-8"})
    return text.replace("N | last", "N|last")


def verbs():
    return re.findall(r"^  ([a-z]+) ", run_well(["--help"]), re.M)


def options_in_help(verb):
    return re.findall(rf"^ +({OPTION})", run_well([verb, "--help"]), re.M)


def options_in_page(text, verb):
    begin = text.index(f"\n   twinlock {verb} ")
    section = text[begin:re.search(r"\n(   \w|\w)", text[begin + 4:]).start() + begin + 4]
    return re.findall(rf"^ {{7}}({OPTION})", section, re.M)


def test_no_warnings():
    for page in PAGE, KEYS_PAGE:
        path = scratch() / page.stem
        path.write_bytes(gzip.decompress(page.read_bytes()))
        command = f"man --warnings=w -E UTF-8 -l -Tutf8 -Z '{path}' 2>&1 >'{path}.out'"
        said = debian.output_of("sh", "-c", command, env={"PATH": "/usr/bin:/bin", "LC_ALL": "C.UTF-8", "MANWIDTH": "80"})
        expect(said == "", said)


def test_every_verb_is_there():
    text = rendered()
    found = re.findall(r"^   twinlock ([a-z]+) ", text, re.M)
    expect(found == verbs() and len(found) >= 5, f"{found} in the page, {verbs()} in the help")


def test_options_are_those_of_the_help():
    text = rendered()
    for verb in verbs():
        helped, paged = options_in_help(verb), options_in_page(text, verb)
        expect("--help" in helped and helped == paged, f"{verb}: the help has {helped}, the page {paged}")


def test_exit_codes():
    said = re.search(r"Exit codes: (.*)\.", " ".join(run_well(["--help"]).split()))[1]
    text = rendered()
    section = text[text.index("EXIT STATUS"):text.index("EXAMPLES")]
    paged = re.findall(r"^ +(\d+) +(.*)\.$", section, re.M)
    wanted = [tuple(part.split(" ", 1)) for part in said.split(", ")]
    expect([(code, text.lower()) for code, text in paged] == [(code, text.lower()) for code, text in wanted],
           f"{paged}, but the help says {said}")


def test_files_that_it_names_are_there():
    root = PAGE.parents[4]
    names = re.findall(r"/usr/(?:share|lib)/twinlock[\w./-]*\w|/usr/share/doc[\w./-]*\w", rendered())
    expect(len(names) >= 5, f"{names}")
    for name in names:
        expect((root / name.lstrip("/")).exists(), f"the page names {name}, which is not installed")



# ---- twinlock.json(5) ----

def resolved(node):
    return {**resolved(SCHEMA["$defs"][node["$ref"].split("/")[-1]]), **node} if "$ref" in node else node


def objects():
    """Each object of the schema that has keys, once."""
    found = []

    def visit(node):
        if isinstance(node, dict) and node.get("type") == "object" and "properties" in node:
            found.append(node)
        for key, inner in node.items() if isinstance(node, dict) else enumerate(node if isinstance(node, list) else ()):
            if key not in ("if", "not"):
                visit(inner)
    visit(SCHEMA)
    return found


def test_every_key_is_described_with_its_default():
    text = rendered(KEYS_PAGE)
    count = 0
    for node in objects():
        for key, raw in node["properties"].items():
            value = resolved(raw)
            said = value.get("description", "")
            expect(said, f"{key} has no description")
            needs_no_default = key in node.get("required", []) or value.get("type") == "object" or "default" in value
            expect(needs_no_default or "efault" in said, f"{key}: no default in the schema, nor in \"{said}\"")
            words = " ".join(said.split())
            expect(words in " ".join(text.split()), f"the page lacks {key}: {words}")
            count += 1
    expect(count > 100, f"{count} keys")


def test_defaults_ranges_and_sections():
    text = " ".join(rendered(KEYS_PAGE).split())
    for part in ('step_s (number, ≥ 1e-05, ≤ 3600; required)', 'max_mb (number, ≥ 1, ≤ 1e+09; default 1000)',
                 'parity ("even", "odd", "none"; default "even")', "components.NAME", "sources.NAME.modbus_tcp",
                 "synchronise.match.VARIABLE.condition", "plant.SIGNAL.modbus"):
        expect(part in text, f"the page lacks {part}")


def test_the_example_is_the_configuration():
    page = gzip.decompress(KEYS_PAGE.read_bytes()).decode()
    example = page[page.rindex(".EX\n") + 4:page.rindex(".EE")].replace("\\-", "-").replace("\\e", "\\")
    document = json.loads(example)
    expect(document == json.loads((SOURCE / "config/motor/lock.json").read_text(encoding="utf-8")), "another example")


def test_snippets_are_valid():
    for name in "source", "signal", "adjusted", "match":
        node = SCHEMA["$defs"][name]
        expect(len(node["defaultSnippets"]) >= 2, f"{name}: too few snippets")
        for snippet in node["defaultSnippets"]:
            whole = {**copy.deepcopy(node), "$defs": SCHEMA["$defs"]}
            jsonschema.Draft202012Validator(whole).validate(snippet["body"])
            expect(json.dumps(snippet["body"]) in rendered(KEYS_PAGE).replace("\n", " ") or len(json.dumps(snippet["body"])) > 100,
                   f"the page lacks {snippet['label']}")


main()

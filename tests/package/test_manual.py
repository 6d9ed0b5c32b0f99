#!/usr/bin/env python3
"""The manual page renders, and has the same verbs and options as the help."""
import gzip
import re

import debian
from twinlock_test import expect, main, run_well, scratch

debian.need("man")
PAGE = debian.unpacked(debian.make()) / "usr/share/man/man1/twinlock.1.gz"
# "--db FILE", "--run N|last", "--json": the parameter of an option is in capitals.
OPTION = r"--[a-z][a-z-]*(?: (?:[A-Z][A-Z0-9]*(?:\|[a-z]+)?)(?= |$))?"


def rendered():
    """The page as plain text with 120 columns."""
    options = ["-P", "cat", "--no-hyphenation", "--no-justification"]
    text = debian.output_of("man", *options, "-l", PAGE, env={"PATH": "/usr/bin:/bin", "MANWIDTH": "120",
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
    path = scratch() / "twinlock.1"
    path.write_bytes(gzip.decompress(PAGE.read_bytes()))
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


main()

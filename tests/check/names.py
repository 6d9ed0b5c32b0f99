#!/usr/bin/env python3
"""What no file of ours may contain: places of one machine, package registries, leftovers, untidy text."""
import os
import re

import tree

# Patterns are put together from pieces so that this file does not match itself.
REGISTRIES = "|".join(["debian", "ubuntu", "pypi", "pythonhosted", "npmjs", "crates", "golang", "maven"])
FORBIDDEN = [
    (re.compile(r"(?<![\w.$}-])/(?:work|home|root|Users)/\w"), "a path of one machine"),
    (re.compile(r"/tmp/" + r"bash_" + "jobs"), "a path of one machine"),
    (re.compile(r"\b(?:" + REGISTRIES + r")\.(?:org|io|com|net|dev)\b", re.I), "the host of a package registry"),
    (re.compile(r"\b(?:TO" r"DO|FIX" r"ME|XX" r"X|HA" r"CK)\b"), "a leftover: do it, or file it"),
]
SEEDS = "tests/fuzz/seeds/"  # bytes as they were found
PUBLIC_FMUS = "script/studies/public_fmus.txt"  # repositories from which a user may fetch FMUs
URL = re.compile(r"https?://([A-Za-z0-9.\[:-]+)")
# Standards, licences, this machine, and the names reserved for examples.
ALLOWED_HOSTS = re.compile(
    r"(www\.)?(apache|w3|json-schema|fmi-standard|modelica|spdx|freedesktop|editorconfig)\.org"
    r"|localhost|127\.[0-9.]+|0\.0\.0\.0|\[.*|192\.0\.2\.[0-9]+|box|plant|twinlock"
    r"|([\w-]+\.)*(example|example\.(com|org|net)|test|invalid|local)")

# Code in a one-line comment. Longer comments may show an example.
COMMENT = re.compile(r"^\s*(?://|/\*)\s*(.*?)\s*(?:\*/)?$")
CODE = re.compile(
    r"(?:if|for|while|switch)\s*\(.*\)\s*[{;]?$|return\b.*;$|else\b.*[{;]$"
    r"|[\w.\[\]>-]+\s*[-+*/|&]?=\s*.*;$|\w+\(.*\);$|[})];?$"
    r"|(?:static|const|unsigned|int|double|char|void|struct|size_t|bool)\b.*[;{]$|#\s*(?:include|define|if|endif)\b")


def check_text(path, lines):
    for number, line in enumerate(lines, 1):
        for pattern, what in FORBIDDEN:
            match = pattern.search(line)
            if match:
                tree.finding(path, number, f"{what}: {match[0]}")
        for match in URL.finditer(line):
            host = match[1] if match[1].startswith("[") else match[1].split(":")[0].rstrip(".")
            if not ALLOWED_HOSTS.fullmatch(host) and (path, host) != (PUBLIC_FMUS, "github.com"):
                tree.finding(path, number, f"an address that is neither a standard's nor an example: {match[0]}")
        if line != line.rstrip():
            tree.finding(path, number, "spaces at the end of the line")


def check_c(path, lines):
    for number, line in enumerate(lines, 1):
        if "\t" in line:
            tree.finding(path, number, "a tab")
        if re.match(r"\s*#\s*if\s+0\b", line):
            tree.finding(path, number, "code that is switched off")
        comment = COMMENT.match(line)
        if comment and CODE.match(comment[1]):
            tree.finding(path, number, "code in a comment")


def check_file(path):
    with open(os.path.join(tree.root, path), "rb") as file:
        content = file.read()
    if b"\0" in content or path == "LICENSE" or path.startswith(SEEDS) or not content:
        return
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError:
        tree.finding(path, 0, "is not UTF-8")
        return
    if not text.endswith("\n") or text.endswith("\n\n"):
        tree.finding(path, 0, "must end with exactly one newline")
    if "\r" in text:
        tree.finding(path, 0, "has carriage returns")
    lines = text.replace("\r", "").split("\n")
    check_text(path, lines)
    if path.endswith((".c", ".h")):
        check_c(path, lines)
    if text.startswith("#!") != os.access(os.path.join(tree.root, path), os.X_OK):
        tree.finding(path, 0, "a script has #! and the executable bit, anything else neither")


def main():
    paths = tree.files()
    for path in paths:
        if not os.path.islink(os.path.join(tree.root, path)):
            check_file(path)
    tree.finish(f"{len(paths)} files")


main()

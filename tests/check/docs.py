#!/usr/bin/env python3
"""The documents tell the truth: relative links lead somewhere, commands that begin with script/ exist, and so do the
options of a verb of twinlock."""
import os
import re
import shlex

import tree

LINK = re.compile(
    r"!?\[[^\]]*\]\(<?([^)\s>]+)>?[^)]*\)"  # [text](target), ![text](target)
    r"|^\s*\[[^\]]+\]:\s*(\S+)"  # [name]: target
    r"|<(?:img|a)\s[^>]*?(?:src|href)=\"([^\"]+)\"")
FENCE = re.compile(r"^\s*(```+|~~~+)\s*(\w*)")
HEADING = re.compile(r"^#+\s+(.*?)\s*#*$")
COMMAND = re.compile(r"^\s*(?:\$ |# |sudo )?(?:\./)?((?:script|\.ci)/\S+)(.*)$")

# {CHECK | REPLAY, "call-limit", …: a row of the table that the program reads its command line by.
OPTION_TABLE = "firmware/cli/options.c"
OPTION_ROW = re.compile(r'^    \{([A-Z]+(?: \| [A-Z]+)*), "([a-z-]+)",', re.M)
# twinlock run CONFIG --duration 3, up to the end of the command
VERB = re.compile(r"(?<![\w/-])twinlock (check|replay|run|plant|show)\b([^`|;#&]*)")


def anchor(heading):
    """The name that a heading gets in a rendered page."""
    return re.sub(r"[^\w\- ]", "", re.sub(r"[`*_]|\]\([^)]*\)", "", heading).lower()).strip().replace(" ", "-")


def lines_of(path):
    """(number, line, inside a fenced block) for each line."""
    fence = None
    for number, line in enumerate(tree.text(path).splitlines(), 1):
        mark = FENCE.match(line)
        if mark and (fence is None or line.strip().startswith(fence)):
            fence = mark[1] if fence is None else None
            continue
        yield number, line, fence is not None


def anchors(path):
    headings = [HEADING.match(line) for _, line, fenced in lines_of(path) if not fenced]
    return {anchor(heading[1]) for heading in headings if heading}


def check_link(path, number, link):
    if re.match(r"[a-z]+:", link) or link.startswith("/"):
        return
    name, _, fragment = link.partition("#")
    target = os.path.normpath(os.path.join(os.path.dirname(path), name)) if name else path
    if not os.path.exists(os.path.join(tree.root, target)):
        tree.finding(path, number, f"the link leads nowhere: {link}")
    elif fragment and target.endswith(".md") and fragment not in anchors(target):
        tree.finding(path, number, f"no such heading: {link}")


def check_command(path, number, line):
    command = COMMAND.match(line)
    if not command:
        return
    name = shlex.split(command[1] + " ", comments=True)[0].rstrip(";")
    script = os.path.join(tree.root, name)
    if not os.path.isfile(script) or not os.access(script, os.X_OK):
        tree.finding(path, number, f"no such command: {name}")


def read_options():
    """The options of each verb, by its name; an empty dictionary if this tree has no program."""
    if not os.path.exists(os.path.join(tree.root, OPTION_TABLE)):
        return {}
    options = {}
    for verbs, option in OPTION_ROW.findall(tree.text(OPTION_TABLE)):
        for verb in verbs.lower().split(" | "):
            options.setdefault(verb, set()).add("--" + option)
    return options


def check_options(path, number, line, options):
    for verb, words in VERB.findall(line) if options else ():
        for word in re.findall(r"(?<![\w-])--[a-z-]+", words):
            if word not in options.get(verb, set()) | options["every"]:
                tree.finding(path, number, f"twinlock {verb} has no option {word}")


def main():
    documents = tree.files(".md")
    options = read_options()
    for path in documents:
        for number, line, fenced in lines_of(path):
            check_options(path, number, line, options)
            if fenced:
                check_command(path, number, line)
                continue
            for match in LINK.finditer(re.sub(r"`[^`]*`", "", line)):
                check_link(path, number, match[1] or match[2] or match[3])
    tree.finish(f"{len(documents)} documents")


main()

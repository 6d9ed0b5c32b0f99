#!/usr/bin/env python3
"""Whether comments of the product are plain: no word of words.txt, lines within 100 columns, and short sentences in headers."""
import os
import re

import tree

HERE = os.path.dirname(os.path.abspath(__file__))
WIDTH = 100
MEDIAN, MOST = 14, 25  # words of a sentence in the headers: half of them, and nine of ten
COMMENT = re.compile(r'"(?:\\.|[^"\\\n])*"|/\*(.*?)\*/', re.S)
PRODUCT = re.compile(r"(?:master|board|firmware|fmus)/.*\.[ch]$")


def read_phrases():
    with open(os.path.join(HERE, "words.txt"), encoding="utf-8") as file:
        pairs = [line.rstrip("\n").split(": ", 1) for line in file if not line.startswith("#")]
    starts = [f"(?<![\\w`])(?<!there )[{phrase[0]}{phrase[0].upper()}]{re.escape(phrase[1:])}(?![\\w`(])" for phrase, _ in pairs]
    return [(re.compile(start), better) for start, (_, better) in zip(starts, pairs)]


def sentences(text):
    text = re.sub(r"^\s*\*? ?", "", text, flags=re.M)
    for part in re.split(r"(?<=[.;:!?])\s|\n\s*\n|\n(?=[A-Z][A-Za-z ]*: )", text):
        words = re.findall(r"[A-Za-z][\w'’-]*", part)
        if words:
            yield len(words)


def check_file(path, phrases, lengths):
    with open(os.path.join(tree.root, path), encoding="utf-8") as file:
        text = file.read()
    for match in COMMENT.finditer(text):
        if match[1] is None:
            continue
        first = text.count("\n", 0, match.start()) + 1
        own = not text[text.rfind("\n", 0, match.start()) + 1 : match.start()].strip()
        for number, line in enumerate(match[0].split("\n"), first):
            if own and len(line) > WIDTH and " " in line.strip():
                tree.finding(path, number, f"a comment of {len(line)} columns, {WIDTH} at most")
        for phrase, better in phrases:
            for found in phrase.finditer(match[1]):
                number = first + match[1].count("\n", 0, found.start())
                tree.finding(path, number, f'"{found[0]}" in a comment: write {better}')
        if path.endswith(".h"):
            lengths += sentences(match[1])


def main():
    phrases, lengths = read_phrases(), []
    paths = [path for path in tree.files() if PRODUCT.match(path)]
    for path in paths:
        check_file(path, phrases, lengths)
    lengths.sort()
    median, most = lengths[len(lengths) // 2], lengths[len(lengths) * 9 // 10]
    print(f"sentences of headers: half have at most {median} words, nine of ten at most {most}")
    if median > MEDIAN or most > MOST:
        tree.finding("headers", 0, f"sentences are too long: {MEDIAN} and {MOST} words at most")
    tree.finish(f"{len(paths)} files")


main()

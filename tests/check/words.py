#!/usr/bin/env python3
"""Whether what people read is plain: no phrase of words.txt in comments, messages and documents, no word of names.txt in names,
comments within 100 columns, and short sentences in public headers and in documents."""
import os
import re

import tree

HERE = os.path.dirname(os.path.abspath(__file__))
WIDTH = 100
MEDIAN, MOST = 14, 25  # words of a sentence: half of them, and nine of ten
TEXT = re.compile(r'"((?:\\.|[^"\\\n])*)"|/\*(.*?)\*/', re.S)
CODE = re.compile(r"^```.*?^```$|`[^`\n]*`|<!--.*?-->|\]\([^)\s]*\)", re.M | re.S)
PRODUCT = re.compile(r"(?:master|board|firmware|fmus)/.*\.[ch]$")


def read_phrases():
    """[(pattern, what to write in its place, paths that may have it)]"""
    found = []
    with open(os.path.join(HERE, "words.txt"), encoding="utf-8") as file:
        for line in file:
            if not line.startswith("#"):
                phrase, better = line.rstrip("\n").split(": ", 1)
                better, _, excepted = better.partition(" | except ")
                start = f"(?<![\\w`])(?<!there )[{phrase[0]}{phrase[0].upper()}]{re.escape(phrase[1:])}(?![\\w`(])"
                found.append((re.compile(start), better, tuple(excepted.split(", ")) if excepted else ()))
    return found


def read_names():
    """{word of a name: what to write in its place}"""
    with open(os.path.join(HERE, "names.txt"), encoding="utf-8") as file:
        return dict(line.rstrip("\n").split(": ", 1) for line in file if not line.startswith("#"))


def check_names(path, names, text):
    code = TEXT.sub(lambda match: re.sub(r"[^\n]", " ", match[0]), text)
    for match in re.finditer(r"[A-Za-z_]\w*", code):
        for word in set(match[0].lower().split("_")) & names.keys():
            tree.finding(path, code.count("\n", 0, match.start()) + 1, f'"{match[0]}": write {names[word]} for {word}')


def sentences(text):
    text = re.sub(r"^\s*[*>]? ?", "", text, flags=re.M)
    for part in re.split(r"(?<=[.;:!?])\s|\n\s*\n|\n(?=[A-Z][A-Za-z ]*: )|\n(?=[*0-9|#])", text):
        words = re.findall(r"[A-Za-z][\w'’-]*", part)
        if words:
            yield len(words)


def check_phrases(path, phrases, text, first, where):
    for phrase, better, excepted in phrases:
        for found in phrase.finditer(text) if path not in excepted else ():
            tree.finding(path, first + text.count("\n", 0, found.start()), f'"{found[0]}" in {where}: write {better}')


def check_source(path, phrases, names, lengths):
    text = tree.text(path)
    check_names(path, names, text)
    for match in TEXT.finditer(text):
        first = text.count("\n", 0, match.start()) + 1
        if match[1] is not None:
            check_phrases(path, phrases, match[1], first, "a message")
            continue
        own = not text[text.rfind("\n", 0, match.start()) + 1 : match.start()].strip()
        for number, line in enumerate(match[0].split("\n"), first):
            if own and len(line) > WIDTH and " " in line.strip():
                tree.finding(path, number, f"a comment of {len(line)} columns, {WIDTH} at most")
        check_phrases(path, phrases, match[2], first, "a comment")
        if path.endswith(".h"):
            lengths += sentences(match[2])


def check_document(path, phrases, lengths):
    text = CODE.sub(lambda match: re.sub(r"[^\n]+", "x", match[0]), tree.text(path))
    check_phrases(path, phrases, text, 1, "a document")
    lengths += sentences(re.sub(r"^\|.*$", "", text, flags=re.M))


def check_lengths(what, lengths):
    lengths.sort()
    median, most = lengths[len(lengths) // 2], lengths[len(lengths) * 9 // 10]
    print(f"sentences of {what}: half have at most {median} words, nine of ten at most {most}")
    if median > MEDIAN or most > MOST:
        tree.finding(what, 0, f"sentences are too long: {MEDIAN} and {MOST} words at most")


def main():
    phrases, names, headers, documents = read_phrases(), read_names(), [], []
    sources = [path for path in tree.files(".c", ".h") if PRODUCT.match(path)]
    pages = tree.files(".md")
    for path in sources:
        check_source(path, phrases, names, headers)
    for path in pages:
        check_document(path, phrases, documents)
    check_lengths("headers", headers)
    if documents:
        check_lengths("documents", documents)
    tree.finish(f"{len(sources) + len(pages)} files")


main()

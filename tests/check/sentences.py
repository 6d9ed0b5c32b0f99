#!/usr/bin/env python3
"""Wording may improve without a test: `sentences.py [ROOT]` finds tests that hold a sentence of the program word for word.

Tests hold exit codes, paths, values and at most three words in a row (tests/support/message.h, has_line() of twinlock_test.py).
A sentence counts if a text of a test has five words in a row that also follow each other in a text of the product; SQL does not.
"""
import ast
import re

import tree

WORDS = 5  # in a row
C_TEXT = re.compile(r'"(?:\\.|[^"\\\n])*"(?:\s*(?:PRI\w+\s*)?"(?:\\.|[^"\\\n])*")*')
C_COMMENT = re.compile(r'("(?:\\.|[^"\\\n])*")|/\*.*?\*/|//[^\n]*', re.DOTALL)
PLACEHOLDER = re.compile(r"%[-+.*0-9]*(?:ll|l|z|j)?[a-zA-Z%]")
SQL = re.compile(r"\b(ALTER|SELECT|UPDATE|DELETE|INSERT|FROM|WHERE|JOIN|PRAGMA|GROUP BY|ORDER BY)\b")
PRODUCT = ("firmware", "board", "master", "fmus")
SKIPPED = ("tests/check/", "tests/bench/", "tests/fuzz/")


def c_texts(text):
    """Line and content of each string of a C file, neighbours joined."""
    bare = C_COMMENT.sub(lambda match: match[1] or "\n" * match[0].count("\n"), text)
    for match in C_TEXT.finditer(bare):
        if bare[: match.start()].rsplit("\n", 1)[-1].lstrip().startswith("#include"):
            continue
        parts = re.findall(r'"((?:\\.|[^"\\\n])*)"', match[0])
        yield bare.count("\n", 0, match.start()) + 1, "".join(parts)


def python_texts(text):
    module = ast.parse(text)
    documented = {id(node.body[0].value) for node in ast.walk(module)
                  if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)) and node.body and isinstance(node.body[0], ast.Expr)}
    for node in ast.walk(module):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in documented:
            yield node.lineno, node.value


def rows(text):
    """Sequences of words: a value, a placeholder or a sign ends one."""
    if SQL.search(text):
        return
    text = re.sub(r"\\[nt]", " \x00 ", PLACEHOLDER.sub(" \x00 ", text))
    for part in re.split(r"[^A-Za-z' ]+", text):
        words = part.split()
        if len(words) >= WORDS:
            yield words


def runs(words):
    return {tuple(words[at:at + WORDS]) for at in range(len(words) - WORDS + 1)}


def product_runs():
    found = set()
    for path in tree.files(".c", ".h", under=PRODUCT):
        for _, text in c_texts(tree.text(path)):
            for words in rows(text):
                found |= runs(words)
    return found


def main():
    known = product_runs()
    looked_at = 0
    for path in tree.files(".c", ".h", ".py"):
        if not path.startswith("tests/") or path.startswith(SKIPPED):
            continue
        looked_at += 1
        for line, text in python_texts(tree.text(path)) if path.endswith(".py") else c_texts(tree.text(path)):
            held = next((" ".join(run) for words in rows(text) for run in sorted(runs(words)) if run in known), None)
            if held:
                tree.finding(path, line, f'holds a sentence of the program ("{held}"): hold values')
    tree.finish(looked_at)


if __name__ == "__main__":
    main()

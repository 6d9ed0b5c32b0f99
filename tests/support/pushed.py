"""`twinlock push` to a box of served.py: how it is called, and what it should end with."""
import os
import subprocess

from twinlock_test import PROGRAM, expect, scratch


def arguments(box, *words, config=None, pin=True, role="retune", plant="motor", env=None):
    """Of `twinlock push`, and its environment."""
    args = [PROGRAM, "push"]
    if config is not None:
        path = scratch() / "new.json"
        path.write_bytes(config)
        args.append(str(path))
    args += [f"https://127.0.0.1:{box.port}/{plant}", *map(str, words)]
    args += ["--pin", box.pin] if pin is True else ["--pin", pin] if pin else []
    variables = {**os.environ, "TWINLOCK_TOKEN": box.tokens.get(role, role or "")} if env is None else env
    return args, variables


def push(box, *words, **how):
    """(exit code, standard output, standard error) of `twinlock push`."""
    args, variables = arguments(box, *words, **how)
    done = subprocess.run(args, capture_output=True, encoding="utf-8", env=variables, check=False, timeout=60)
    expect("Sanitizer" not in done.stderr and "runtime error" not in done.stderr, done.stderr)
    return done.returncode, done.stdout, done.stderr


def expect_push(found, code, *words):
    for word in words:
        expect(word in found[1] + found[2], f"no \"{word}\" in {found}")
    expect(found[0] == code, f"ended with {found[0]}, wanted {code}: {found[1]}{found[2]}")


def pushing(box, *words, **how):
    """The same, while it runs."""
    args, variables = arguments(box, *words, **how)
    return subprocess.Popen(args, stdout=subprocess.PIPE, stderr=subprocess.PIPE, encoding="utf-8", env=variables)

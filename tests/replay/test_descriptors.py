#!/usr/bin/env python3
"""Too few file descriptors, one more each time: exit code 75 with the reason, and no temporary file, until there are enough."""
import os
import resource

from twinlock_test import EMULATED, Skip, config_path, expect, has_line, main, run

MOST = 40
TRY_AGAIN = 75
os.environ["ASAN_OPTIONS"] = os.environ.get("ASAN_OPTIONS", "") + ":detect_leaks=0"  # the leak detector needs descriptors


def with_limit(limit, args):
    """run() with descriptors 0 to limit − 1 only."""
    return run(args, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (limit, limit)))


def least():
    """The least limit with which the loader can open the program's libraries."""
    if EMULATED:
        raise Skip("an emulator does not limit descriptors")
    for limit in range(3, MOST):
        try:
            if with_limit(limit, ["--version"])[0] == 0:
                return limit
        except AssertionError:
            pass
    raise Skip("no such limit here")


def expect_try_again_until_done(args, most_descriptors):
    begin = least()
    codes = []
    for limit in range(begin, begin + most_descriptors):
        code, _, err = with_limit(limit, args)
        expect(code in (0, TRY_AGAIN), f"{limit} descriptors: ended with {code}\n{err}")
        expect(code == 0 or has_line(err, "error|Too many open files"), f"{limit} descriptors: another reason\n{err}")
        expect("removed" not in err, f"{limit} descriptors: a file was left\n{err}")
        codes.append(code)
    print(f"    {' '.join(map(str, codes))}")
    expect(codes[0] == TRY_AGAIN and codes[-1] == 0, f"unexpected limits: {codes}")
    expect(codes == sorted(codes, reverse=True), f"a higher limit fails: {codes}")


def test_check():
    expect_try_again_until_done(["check", config_path("motor/free.json")], 40)


def test_replay():
    expect_try_again_until_done(["replay", config_path("motor/free.json")], 40)


main()

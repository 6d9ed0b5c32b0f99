#!/usr/bin/env python3
"""The checks bite: each rule is broken once in a small tree of its own, and the check must say so."""
import json
import os
import subprocess
import sys
import tempfile

HERE = os.path.dirname(os.path.abspath(__file__))


def header(path, *lines):
    """A header that breaks no rule but those in the lines."""
    guard = "TL_" + path.upper().replace("/", "_").replace(".", "_")
    body = "\n".join(lines)
    return f"/* A header that a check looks at. */\n#ifndef {guard}\n#define {guard}\n{body}\n#endif\n"


CLEAN = {
    "master/base/a.h": header("master/base/a.h", "#include <stddef.h>"),
    "master/solve/s.h": header("master/solve/s.h", '#include "master/base/a.h"'),
    "master/solve/s.c": '#include "master/solve/s.h"\n#include <nlopt.h>\n',
    "board/io/plant_io.h": header("board/io/plant_io.h", '#include "master/base/a.h"'),
    "board/csv/csv.h": header("board/csv/csv.h", '#include "board/io/plant_io.h"'),
    "board/csv/csv.c": '#include "board/csv/csv.h"\n#include <unistd.h>\n',
    "board/csv/csv_row.c": '#include "board/csv/csv.h"\n',
    "firmware/plant/live_plant.h": header("firmware/plant/live_plant.h", '#include "board/csv/csv.h"'),
    "firmware/plant/live_plant.c": '#include "firmware/plant/live_plant.h"\n#include "firmware/plant/sample_buffer.h"\n'
                                   '#include "firmware/base/log.h"\n',
    "firmware/plant/sample_buffer.h": header("firmware/plant/sample_buffer.h", "typedef struct mailbox {", "int one;", "} mailbox;"),
    "firmware/plant/mailbox_parts.h": header("firmware/plant/mailbox_parts.h"),
    "firmware/main.c": '#include "firmware/base/log.h"\nstatic const char text[] = "%s: the value is too large";\n',
    "firmware/base/log.h": header("firmware/base/log.h", "typedef int tl_log;"),
    "firmware/cli/options.c": 'option rows[] = {\n    {RUN, "live",\n    {EVERY, "help",\n};\n',
    "README.md": "# One title\nSee [this](master/base/a.h) and [that](#one-title).\n```sh\nscript/go --now\n```\n",
    "script/go": "#!/usr/bin/env bash\nset -e\n",
}

# check, the file that breaks a rule, its text, what the check must say
BROKEN = [
    ("layers", "master/base/a.h", header("master/base/a.h", '#include "master/solve/s.h"'), "master/base may not know"),
    ("layers", "master/solve/s.c", "#include <unistd.h>\n", "plain C99 only"),
    ("layers", "master/solve/s.c", "#include <time.h>\n", "plain C99 only"),
    ("layers", "master/base/b.c", "#include <nlopt.h>\n", "belongs to master/solve"),
    ("layers", "master/base/b.c", '#include "firmware/f.h"\n', "there is no"),
    ("layers", "master/base/b.c", '#include "a.h"\n', "from the root"),
    ("layers", "board/can/can.c", '#include "board/csv/csv.h"\n', "board/can may not know"),
    ("layers", "board/can/can.c", '#include "master/solve/s.h"\n', "board/can may not know"),
    ("layers", "master/plan/plan.h", header("master/plan/plan.h", '#include "master/solve/s.h"'), "may not know"),
    ("layers", "firmware/plant/p.c", '#include "board/csv/csv.c"\n', "includes a source file"),
    ("layers", "firmware/base/b.c", '#include "firmware/plant/live_plant.h"\n', "firmware/base may not know"),
    ("layers", "firmware/twin/r.c", '#include "firmware/plant/mailbox_parts.h"\n', "is private to firmware/plant"),
    ("layers", "firmware/plant/sample_buffer.h", header("firmware/plant/sample_buffer.h", '#include "firmware/plant/live_plant.h"'),
     "know each other in a circle"),
    ("layers", "firmware/plant/p.c", '#include "master/solve/s.h"\n', "firmware/plant may not know"),
    ("layers", "firmware/attic/a.c", "int tl_a;\n", "no folder of the plan"),
    ("size", "firmware/plant/p.c", "int tl_a;\n", "expected 800 to 9000"),
    ("size", "firmware/plant/p.c", "int tl_a;\n", "lines of code, expected 0 within 3%"),
    ("layers", "firmware/plant/p.c", "#include <pthread.h>\n", "<pthread.h> belongs to"),
    ("layers", "firmware/plant/p.c", "#include <sqlite3.h>\n", "<sqlite3.h> belongs to"),
    ("layers", "firmware/plant/p.c", "#include <libusb.h>\n", "<libusb.h> has no owner"),
    ("layers", "firmware/plant/p.c", "#include <wordexp.h>\n", "<wordexp.h> has no owner"),
    ("layers", "board/can/can.c", "#include <board/csv/csv.h>\n", "board/can may not know"),
    ("layers", "firmware/plant/p.c", "#include <firmware/base/log.h>\n", 'say "firmware/base/log.h", not <'),
    ("layers", "master/base/b.c", '/* one */ #include/**/"firmware/base/log.h"\n', "master/base may not know"),
    ("layers", "master/base/b.c", '#import "firmware/base/log.h"\n', "master/base may not know"),
    ("layers", "master/base/b.c", '#define H "firmware/base/log.h"\n#include H\n', 'an include says "a file"'),
    ("layers", "gateway/g.c", "int tl_a;\n", "gateway is no floor"),
    ("layers", "firmware/base/t.c", "#include <cjson/cJSON.h>\n", "<cjson/cJSON.h> belongs to"),
    ("type_names", "board/csv/csv.h", header("board/csv/csv.h", "typedef struct mailbox {", "int two;", "} mailbox;"),
     "defines the type mailbox"),
    ("type_names", "board/csv/csv.c", "typedef int tl_log;\n", "defines the type tl_log"),
    ("type_names", "board/csv/csv.c", "typedef enum { A, B } tl_log;\n", "defines the type tl_log"),
    ("type_names", "board/csv/csv.c", "typedef double tl_log[3][3];\n", "defines the type tl_log"),
    ("picture", "firmware/twin/r.c", '#include "firmware/plant/live_plant.h"\n', "not the code's"),
    ("picture", "docs/folders.svg", "<svg/>\n", "not the code's"),
    ("picture", "firmware/base/log.h", header("firmware/base/log.h", '#include "firmware/plant/live_plant.h"'),
     "folders in a circle"),
    ("layers", "fmus/m/model.c", '#include "master/base/a.h"\n', "fmus/m may not know"),
    ("layers", "master/base/b.c", '#include "description.h"\n', "is not for master"),
    ("layers", "tests/support/t.h", header("tests/support/t.h", '#include "tests/support/t.h"'), "include cycle"),
    ("headers", "master/base/a.h", header("master/base/a.h", "size_t tl_a(void);"), "does not compile alone"),
    ("headers", "master/base/a.h", "#ifndef A_H\n#define A_H\n#endif\n", "must have the include guard"),
    ("headers", "master/base/a.h", "#ifndef A_H\n#define A_H\n#endif\n", "must begin with a comment"),
    ("headers", "master/base/a.h", header("master/base/a.h", "#include <time.h>", "extern struct timespec tl_t;",
                                          "extern clockid_t tl_c;"), "does not compile alone"),
    ("names", "master/base/b.c", "/* see " + "/wo" + "rk/main */\n", "a path of one machine"),
    ("names", "script/go", "#!/bin/bash\ncurl files.python" + "hosted.org\n", "host of a package registry"),
    ("names", "script/go", "#!/bin/bash\ncurl http" + "://files.nowhere.se\n", "neither a standard's nor an example"),
    ("names", "master/base/b.c", "/* TO" + "DO: more */\n", "a leftover"),
    ("names", "master/base/b.c", "\tint x;\n", "a tab"),
    ("names", "master/base/b.c", "int x; \n", "spaces at the end"),
    ("words", "master/base/b.c", "/* Nob" + "ody knows. */\n", "in a comment: write"),
    ("words", "master/base/b.c", 'const char tl_a[] = "nob' + 'ody knows";\n', "in a message: write"),
    ("words", "master/base/b.c", "int tl_a_new" + "s;\n", "write outcome"),
    ("words", "README.md", "# A\nNob" + "ody knows.\n", "in a document: write"),
    ("words", "README.md", "# A\n" + "One" + " more word" * 20 + ".\n", "sentences are too long"),
    ("sentences", "tests/unit/test_a.c", 'const char tl_a[] = "7: the value is too large";\n', "holds a sentence of the program"),
    ("sentences", "tests/replay/test_a.py", 'TEXT = f"{x}: the value is too large"\n', "holds a sentence of the program"),
    ("words", "master/base/b.c", "/* A line" + " of words" * 12 + " */\n", "a comment of"),
    ("words", "master/base/b.h", header("master/base/b.h", *["/* One" + " more word" * 20 + ". */"] * 9), "sentences are too long"),
    ("names", "master/base/b.c", "int x;", "one newline"),
    ("names", "master/base/b.c", "/* x = y + 1; */\n", "code in a comment"),
    ("names", "master/base/b.c", "#if 0\n#endif\n", "switched off"),
    ("names", "script/no", "#!/usr/bin/env bash\n", "executable bit"),
    ("docs", "README.md", "[gone](gone.md)\n", "leads nowhere"),
    ("docs", "README.md", "# A\n[gone](#gone)\n", "no such heading"),
    ("docs", "README.md", "```sh\nscript/gone --fast\n```\n", "no such command"),
    ("docs", "README.md", "`twinlock run x.json --gone 3`\n", "twinlock run has no option --gone"),
    ("docs", "README.md", "```sh\ntwinlock show x.db --live\n```\n", "twinlock show has no option --live"),
]


def write(root, files):
    for path, text in files.items():
        name = os.path.join(root, path)
        os.makedirs(os.path.dirname(name), exist_ok=True)
        with open(name, "w", encoding="utf-8") as file:
            file.write(text)
        os.chmod(name, 0o755 if path == "script/go" else 0o644)


def run(check, changes):
    """The exit code and the output of a check on the clean tree with some changes."""
    command = [sys.executable, os.path.join(HERE, check + ".py")]
    with tempfile.TemporaryDirectory() as root:
        write(root, CLEAN)
        if check == "picture":
            subprocess.run([*command, root, "--write"], stdout=subprocess.PIPE, check=True)
        write(root, changes)
        done = subprocess.run([*command, root], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
        return done.returncode, done.stdout


# the source of an object of the master, what symbols.py must say about it
SYMBOLS = [
    ("base/arena.c", "#include <stdlib.h>\nvoid *tl_a(void) {\n    return malloc(1);\n}\n", "0 findings"),
    ("base/b.c", "#include <stdlib.h>\nvoid *tl_b(void) {\n    return malloc(1);\n}\n", "needs malloc"),
    ("base/b.c", "#include <stdio.h>\nvoid tl_b(void) {\n    (void)puts(\"b\");\n}\n", "needs puts"),
    ("base/b.c", "#include <time.h>\nlong tl_b(void) {\n    return (long)time(NULL);\n}\n", "needs time"),
    ("base/b.c", "extern int tl_c;\nint tl_b(void) {\n    return tl_c;\n}\n", "needs tl_c"),
    ("base/b.c", "int b;\n", "offers b"),
]

# two objects of the master that call each other
CIRCLES = [("base/a.c", "base/b.c"), ("base/a.c", "solve/s.c")]
CALLS = ("int tl_one(void);\nint tl_other(void);\nint tl_one(void) {\n    return tl_other();\n}\n",
         "int tl_one(void);\nint tl_other(void);\nint tl_other(void) {\n    return tl_one();\n}\n")

# The same of a driver of the board.
BOARD_SYMBOLS = [
    ("can/can_link.c", "#include <sys/socket.h>\nlong tl_a(int s, void *m) {\n    return recvmsg(s, m, 0);\n}\n", "0 findings"),
    ("can/can_link.c", "#include <unistd.h>\nlong tl_a(int s) {\n    return write(s, \"\", 1);\n}\n", "needs write"),
    ("can/can_x.c", "#include <sys/socket.h>\nlong tl_a(int s) {\n    return send(s, \"\", 1, 0);\n}\n", "needs send"),
    ("can/can.c", "#include <sys/socket.h>\nlong tl_a(int s, void *m) {\n    return recvmsg(s, m, 0);\n}\n", "needs recvmsg"),
    ("can/can_link.c", "long syscall(long n, ...);\nlong tl_a(void) {\n    return syscall(1);\n}\n", "needs syscall"),
    ("io/wake.c", "#include <sys/eventfd.h>\nlong tl_a(int s) {\n    return eventfd_write(s, 1);\n}\n", "0 findings"),
    ("io/wake.c", "#include <unistd.h>\nlong tl_a(int s) {\n    return write(s, \"\", 1);\n}\n", "needs write"),
    ("io/link.c", "#include <sys/eventfd.h>\nlong tl_a(int s) {\n    return eventfd_write(s, 1);\n}\n", "needs eventfd_write"),
    ("modbus/modbus_link.c", "int modbus_write_bit(void *c, int a, int s);\nint tl_a(void *c) {\n    return modbus_write_bit(c, 1, 1);\n}\n", "would write to the plant"),
    ("csv/csv.c", "#include <unistd.h>\nlong tl_a(int s) {\n    return write(s, \"\", 1);\n}\n", "0 findings"),
]


# what a command for a file of the board has, and what hardening.py must say
HARDENING = [
    ("-fstack-protector-strong -fstack-clash-protection -D_FORTIFY_SOURCE=2", "0 findings"),
    ("-fstack-protector-strong -D_FORTIFY_SOURCE=2", "without -fstack-clash-protection"),
    ("-fstack-clash-protection -D_FORTIFY_SOURCE=2", "without -fstack-protector-strong"),
    ("-fstack-protector-strong -fstack-clash-protection", "without -D_FORTIFY_SOURCE=2"),
]


def run_hardening(flags, fmu_flags):
    """The exit code and the output of hardening.py on a build of one file and one FMU."""
    with tempfile.TemporaryDirectory() as root:
        entry = {"file": os.path.join(root, "board/a.c"), "command": f"gcc {flags} -c board/a.c"}
        with open(os.path.join(root, "compile_commands.json"), "w", encoding="utf-8") as file:
            json.dump([entry], file)
        with open(os.path.join(root, "build.ninja"), "w", encoding="utf-8") as file:
            file.write(f"  COMMAND = cd x && gcc -fvisibility=hidden -shared {fmu_flags} -o {root}/fmus/linux64/m.so m.c -lm\n")
        done = subprocess.run([sys.executable, os.path.join(HERE, "hardening.py"), root, root],
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
        return done.returncode, done.stdout


def run_symbols(floor, sources):
    """The exit code and the output of symbols.py on some objects of a floor: source -> its text."""
    with tempfile.TemporaryDirectory() as root:
        for source, text in sources.items():
            name = os.path.join(root, floor, source)
            target = os.path.join(root, "build", floor, "CMakeFiles", f"tl_{floor}.dir", source + ".o")
            for path in (name, target):
                os.makedirs(os.path.dirname(path), exist_ok=True)
            with open(name, "w", encoding="utf-8") as file:
                file.write(text)
            subprocess.run(["gcc", "-std=c99", "-O2", "-c", name, "-o", target], check=True)
        done = subprocess.run([sys.executable, os.path.join(HERE, "symbols.py"), root, os.path.join(root, "build")],
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
        return done.returncode, done.stdout


def main():
    failures = 0
    for check in ("layers", "type_names", "picture", "headers", "names", "words", "sentences", "docs"):
        code, output = run(check, {})
        if code != 0:
            failures += 1
            print(f"{check} finds fault with a clean tree:\n{output}")
    for check, path, text, expected in BROKEN:
        code, output = run(check, {path: text})
        if code != 1 or expected not in output:
            failures += 1
            print(f"{check} does not say '{expected}' about {path}; it ends with {code} and says:\n{output}")
    objects = [("master", {source: text}, said) for source, text, said in SYMBOLS]
    objects += [("board", {source: text}, said) for source, text, said in BOARD_SYMBOLS]
    objects += [("master", dict(zip(pair, CALLS)), "call each other in a circle") for pair in CIRCLES]
    for floor, sources, expected in objects:
        code, output = run_symbols(floor, sources)
        if code != (0 if expected.startswith("0 ") else 1) or expected not in output:
            failures += 1
            print(f"symbols does not say '{expected}' about {', '.join(sources)}; it ends with {code} and says:\n{output}")
    whole = HARDENING[0][0]
    commands = [(flags, whole, said) for flags, said in HARDENING] + [(whole, flags, said) for flags, said in HARDENING]
    for flags, fmu_flags, expected in commands:
        code, output = run_hardening(flags, fmu_flags)
        if code != (0 if expected.startswith("0 ") else 1) or expected not in output:
            failures += 1
            print(f"hardening does not say '{expected}'; it ends with {code} and says:\n{output}")
    print(f"{len(BROKEN) + len(objects) + len(commands)} broken rules, {failures} unnoticed")
    sys.exit(1 if failures else 0)


main()

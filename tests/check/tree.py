"""What the checks share: the files of the project, and how a check reports.

A check is a script with one job: `NAME.py [ROOT]`. It prints one line `path:line: what is wrong` per finding and
ends with 1 if there was one. ROOT is another tree to look at (bite.py uses that to prove that the checks bite).
"""
import os
import subprocess
import sys

IGNORED_FOLDERS = {".git", ".deps", "build", "__pycache__", ".cache"}

root = os.path.abspath(sys.argv[1]) if len(sys.argv) > 1 else os.path.dirname(
    os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
_findings = []


def _walk():
    for folder, folders, names in os.walk(root):
        folders[:] = [name for name in folders if name not in IGNORED_FOLDERS]
        for name in names:
            yield os.path.relpath(os.path.join(folder, name), root)


def _git():
    """What git tracks or would add, also in a clone that is another user's; None where the tree is not a work tree of git's."""
    if not os.path.exists(os.path.join(root, ".git")):
        return None
    done = subprocess.run(["git", "-c", f"safe.directory={os.path.realpath(root)}", "-C", root, "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
                          stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, check=False)
    return [os.fsdecode(name) for name in done.stdout.split(b"\0") if name] if done.returncode == 0 else None


def files(*suffixes, under=()):
    """Paths relative to the root, sorted; only those with one of the suffixes and below one of the folders."""
    paths = _git()
    chosen = []
    for path in sorted(set(_walk() if paths is None else paths)):
        if suffixes and not path.endswith(suffixes):
            continue
        if under and path.split("/")[0] not in under and os.path.dirname(path) not in under:
            continue
        if os.path.isfile(os.path.join(root, path)):
            chosen.append(path)
    return chosen


def text(path):
    with open(os.path.join(root, path), encoding="utf-8") as file:
        return file.read()


def finding(path, line, what):
    _findings.append((path, line, what))


def has_findings():
    return bool(_findings)


def finish(looked_at):
    """Prints the findings and ends the script."""
    for path, line, what in sorted(_findings):
        print(f"{path}:{line}: {what}" if line else f"{path}: {what}")
    print(f"{looked_at} looked at, {len(_findings)} findings")
    sys.exit(1 if _findings else 0)

"""Fetches the public FMUs of a list into a folder: see the command script/fmus, option --public.

Each line of a list has four words: the URL of a git repository, a commit, the SHA-256 of the FMU, and its path (the rest of
the line). Lines that begin with # are comments. git transfers only this commit, and only its FMUs if the server can do that.
"""
import hashlib
import os
import re
import shutil
import subprocess
import sys
from collections import defaultdict
from pathlib import Path
from typing import NamedTuple

from study import Trouble

LIST = Path(__file__).with_suffix(".txt")
PATIENCE = 1800  # s, for one call of git


class Entry(NamedTuple):
    url: str
    commit: str
    sha256: str
    path: str

    @property
    def name(self):
        return "/".join(self.url.removesuffix(".git").split("/")[-2:]) + f"@{self.commit[:7]}: {self.path}"


def read_list(file):
    entries = []
    for number, line in enumerate(file.read_text(encoding="utf-8").splitlines(), 1):
        words = line.split(maxsplit=3)
        if not words or words[0].startswith("#"):
            continue
        if len(words) != 4 or not re.fullmatch("[0-9a-f]{40}", words[1]) or not re.fullmatch("[0-9a-f]{64}", words[2]):
            raise Trouble(f"{file}: line {number}: expected a URL, a commit, a SHA-256 and a path")
        entries.append(Entry(*words))
    return entries


def hash_of(data):
    return hashlib.sha256(data).hexdigest()


def place_of(cache, entry):
    return cache / "fmus" / f"{entry.sha256}.fmu"


def is_there(cache, entry):
    place = place_of(cache, entry)
    return place.is_file() and hash_of(place.read_bytes()) == entry.sha256


def git(repository, *arguments):
    """Standard output of git; raises CalledProcessError. It asks for no password and runs no hooks."""
    return subprocess.run(["git", "--git-dir", repository, "-c", "core.hooksPath=/dev/null", *arguments], check=True, stdin=subprocess.DEVNULL,
                          stdout=subprocess.PIPE, stderr=subprocess.PIPE, timeout=PATIENCE, env={**os.environ, "GIT_TERMINAL_PROMPT": "0"}).stdout


def fetch_commit(repository, url, commit, entries, cache):
    """Writes the FMUs of one commit into the folder; returns {entry: why it is missing}."""
    missing = {}
    if not repository.is_dir():
        subprocess.run(["git", "init", "--quiet", "--bare", repository], check=True)
    for key, value in ("url", url), ("promisor", "true"), ("partialclonefilter", "blob:none"):
        git(repository, "config", f"remote.origin.{key}", value)
    git(repository, "fetch", "--quiet", "--no-tags", "--depth", "1", "--filter=blob:none", "origin", commit)
    for entry in entries:
        try:
            data = git(repository, "cat-file", "blob", f"{commit}:{entry.path}")
        except subprocess.CalledProcessError as error:
            missing[entry] = error.stderr.decode(errors="replace").strip().rpartition("\n")[2]
            continue
        if hash_of(data) != entry.sha256:
            missing[entry] = f"its SHA-256 is {hash_of(data)}"
            continue
        part = place_of(cache, entry).with_suffix(".part")
        part.write_bytes(data)
        part.replace(place_of(cache, entry))
    return missing


def fetch(entries, cache):
    """Fetches what is not there yet; prints each repository, and returns the entries that are there."""
    (cache / "fmus").mkdir(parents=True, exist_ok=True)
    wanted = defaultdict(list)
    for entry in entries:
        if not is_there(cache, entry):
            wanted[entry.url, entry.commit].append(entry)
    for number, ((url, commit), group) in enumerate(wanted.items(), 1):
        print(f"fmus: [{number}/{len(wanted)}] {url} {commit[:12]}: {len(group)} FMUs", file=sys.stderr, flush=True)
        repository = cache / "git" / re.sub(r"\W+", "-", url)
        try:
            for entry, why in fetch_commit(repository, url, commit, group, cache).items():
                print(f"fmus: {url}: {entry.path}: {why}", file=sys.stderr)
        except subprocess.TimeoutExpired:
            print(f"fmus: {url}: git is not done within {PATIENCE} s", file=sys.stderr)
        except subprocess.CalledProcessError as error:
            print(f"fmus: {url}: {error.stderr.decode(errors='replace').strip() if error.stderr else error}", file=sys.stderr)
    shutil.rmtree(cache / "git", ignore_errors=True)
    return [entry for entry in entries if place_of(cache, entry).is_file()]

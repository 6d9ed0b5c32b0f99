#!/usr/bin/env bash
# cppcheck over everything the build compiles, but for what it makes itself (report pages as numbers, which take minutes):
# cppcheck.sh ROOT BUILD. It remembers unchanged files in BUILD/cppcheck.
set -euo pipefail
cd "$1"
build=$2

# readdirCalled: readdir_r is the deprecated one. And cppcheck knows no compiler's macros of its own.
macros=(-D__GNUC__=12 -D__linux__=1 "-D__$(uname -m)__=1")

mkdir -p "$build/cppcheck"
cppcheck --project="$build/compile_commands.json" "${macros[@]}" --cppcheck-build-dir="$build/cppcheck" -j 2 --quiet \
    --std=c99 --library=posix --enable=warning,portability,performance --inline-suppr --error-exitcode=1 \
    --suppress=readdirCalled --suppress="*:$PWD/.deps/*" -i "$PWD/.deps" -i "$build" \
    --template='{file}:{line}: {severity}: {message} [{id}]'

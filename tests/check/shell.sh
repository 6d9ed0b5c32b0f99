#!/usr/bin/env bash
# Every bash script is as shellcheck wants it, and so is what it sources.
set -euo pipefail
cd "${1:-$(dirname "${BASH_SOURCE[0]}")/../..}"

find . \( -name .git -o -name .deps -o -name build \) -prune -o -type f -print0 |
    xargs -0 grep -lZE --max-count=1 '^#!(/usr)?/bin/(env )?(ba)?sh' |
    xargs -0 --no-run-if-empty shellcheck --external-sources

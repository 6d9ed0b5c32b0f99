#!/usr/bin/env bash
# Every C file is as clang-format would write it. To repair: clang-format -i FILE.
set -euo pipefail
cd "${1:-$(dirname "${BASH_SOURCE[0]}")/../..}"
command -v clang-format >/dev/null || { echo "skipped: there is no clang-format: script/bootstrap --all installs it" && exit 77; }

folders=()
for folder in master board firmware fmus tests; do
    [[ -d $folder ]] && folders+=("$folder")
done
find "${folders[@]}" -name '*.[ch]' -print0 | xargs -0 --no-run-if-empty clang-format --dry-run -Werror --style=file

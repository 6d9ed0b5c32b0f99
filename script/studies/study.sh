# shellcheck shell=bash
# What the commands in this folder share: their options are read, twinlock is built, and the Python beside them started.
#
# A command defines usage() and the array `takes`, which says of each option what it takes: nothing, a value, a file or a
# folder that is there, or a file to write. Paths are the caller's, and become absolute: Python runs in the root.

# The path as Python gets it, or the end: path_of NAME KIND PATH
path_of() {
    case $2 in
        file) [[ -r $3 ]] || { echo "$1: cannot read $3" >&2 && exit 65; } ;;
        folder) [[ -d $3 ]] || { echo "$1: $3 is no folder" >&2 && exit 65; } ;;
    esac
    realpath -m -- "$3"
}

# Never returns: run_study NAME ARGUMENT...
run_study() {
    local name=$1 arguments=() kind path root
    shift
    while (($# > 0)); do
        [[ $1 != -h && $1 != --help ]] || { usage && exit 0; }
        kind=${takes["${1:--}"]-unknown}
        [[ $kind != unknown && ($kind == nothing || $# -ge 2) ]] || { usage >&2 && exit 2; }
        arguments+=("$1")
        case $kind in
            value) arguments+=("$2") ;;
            file | folder | new)
                path=$(path_of "$name" "$kind" "$2") || exit
                arguments+=("$path")
                ;;
        esac
        [[ $kind == nothing ]] || shift
        shift
    done
    root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
    cd "$root" || exit
    script/bootstrap --quiet >&2
    script/build >&2
    exec .deps/venv/bin/python "script/studies/$name.py" "${arguments[@]}"
}

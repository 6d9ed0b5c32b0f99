# shellcheck shell=bash
# Common part of the commands in this folder: reads the options, builds twinlock, and starts the Python program.
#
# A command defines usage() and the array `takes`: the kind of argument of each option (nothing, value, existing file or
# folder, or new for a file to write). Relative paths become absolute, because Python runs in the root folder.

# path_of NAME KIND PATH: prints the absolute path; ends with 65 if it does not exist.
path_of() {
    case $2 in
        file) [[ -r $3 ]] || { echo "$1: cannot read $3" >&2 && exit 65; } ;;
        folder) [[ -d $3 ]] || { echo "$1: $3: no such folder" >&2 && exit 65; } ;;
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

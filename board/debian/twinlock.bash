# Completion of twinlock for bash. Verbs and options are those that the program itself names in its help, so that they
# are never those of another version.
# shellcheck shell=bash

_twinlock_verbs() {
    "$1" --help 2>/dev/null | sed -nE 's/^  ([a-z]+) .*/\1/p'
}

# The options of a verb, one a line, as in the help: "--db FILE", "--json".
_twinlock_options() {
    "$1" "$2" --help 2>/dev/null | sed -nE 's/^ +(--[a-z-]+)( [A-Z][A-Z0-9|a-z]*)?( .*)?$/\1\2/p'
}

# The tables that the help lists.
_twinlock_tables() {
    "$1" show --help 2>/dev/null | sed -nE 's/^ +--csv TABLE .*: (.*)$/\1/p' | sed -E 's/, | or / /g'
}

# What may follow an option, by the word that the help has for it.
_twinlock_value() {
    case $2 in
        FILE | DEVICE | CONFIG*) compgen -f -- "$3" ;;
        DIR) compgen -d -- "$3" ;;
        RIGHT | ROLE) compgen -W "read retune commission" -- "$3" ;;
        TABLE) compgen -W "$(_twinlock_tables "$1")" -- "$3" ;;
    esac
}

# Folders, and files that end so.
_twinlock_files() {
    compgen -d -- "$2"
    compgen -f -X "!*$1" -- "$2"
}

_twinlock() {
    local word=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD - 1]} verb=${COMP_WORDS[1]-}
    local options value
    COMPREPLY=()
    if ((COMP_CWORD == 1)); then
        mapfile -t COMPREPLY < <(compgen -W "$(_twinlock_verbs "$1") help --help --version" -- "$word")
        return
    elif [[ $verb == help ]]; then
        mapfile -t COMPREPLY < <(compgen -W "$(_twinlock_verbs "$1")" -- "$word")
        return
    fi
    options=$(_twinlock_options "$1" "$verb")
    value=$(sed -n "s/^$before //p" <<<"$options")
    if [[ $before == --* && -n $value ]]; then
        compopt -o filenames 2>/dev/null
        mapfile -t COMPREPLY < <(_twinlock_value "$1" "$value" "$word" | sort -u)
    elif [[ $word == -* ]]; then
        mapfile -t COMPREPLY < <(compgen -W "$(cut -d ' ' -f 1 <<<"$options")" -- "$word")
    elif [[ $verb == token ]]; then
        mapfile -t COMPREPLY < <(compgen -W "add list revoke" -- "$word")
    else
        compopt -o filenames 2>/dev/null
        if [[ $verb == show || $verb == finding || $verb == explain || $verb == learn ]]; then
            mapfile -t COMPREPLY < <(_twinlock_files .db "$word" | sort -u)
        elif [[ $verb == init ]]; then
            mapfile -t COMPREPLY < <(_twinlock_files .fmu "$word" | sort -u)
        else
            mapfile -t COMPREPLY < <(_twinlock_files .json "$word" | sort -u)
        fi
    fi
}
complete -F _twinlock twinlock

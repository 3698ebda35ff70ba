"""What makes a shell complete commands and their settings."""

from __future__ import annotations

from collections.abc import Iterable

_SCRIPT = """\
# completes `mimicbench`, in bash, and in zsh after bashcompinit
_mimicbench() {
  local current="${COMP_WORDS[COMP_CWORD]}" name="${COMP_WORDS[1]}" key
  COMPREPLY=()
  if [ "$COMP_CWORD" -eq 1 ]; then
    COMPREPLY=($(compgen -W "%(first)s --help --version" -- "$current"))
    return
  fi
  case "$name ${COMP_WORDS[2]}" in
    %(pairs)s) name="$name ${COMP_WORDS[2]}" ;;
  esac
  case "$current" in
    -*) key="_mimicbench_$(printf %%s "$name" | tr -c a-z _)"
        if ! eval "[ -n \\"\\${$key-}\\" ]"; then
          eval "$key=\\$(_mimicbench_settings $name)"
        fi
        COMPREPLY=($(compgen -W "$(eval printf %%s "\\"\\$$key\\"")" -- "$current")) ;;
    *)  [ "$COMP_CWORD" -eq 2 ] && COMPREPLY=($(compgen -W "$(_mimicbench_second "$name")" -- "$current"))
        [ "${#COMPREPLY[@]}" -eq 0 ] && COMPREPLY=($(compgen -f -- "$current")) ;;
  esac
}
_mimicbench_settings() {
  mimicbench "$@" --help 2>/dev/null | grep -oE -- '--[a-z][a-z0-9.-]*' | sort -u | tr '\\n' ' '
}
_mimicbench_second() {
  case "$1" in
%(seconds)s
  esac
}
complete -o filenames -F _mimicbench mimicbench
"""


def script(commands: Iterable[str]) -> str:
    """A script for bash that completes these commands, each of one word or two."""
    names = [command.split() for command in commands]
    first = list(dict.fromkeys(name[0] for name in names))
    pairs = [name for name in names if len(name) == 2]
    second = {one: [name[1] for name in pairs if name[0] == one] for one in first}
    lines = [f"    {one}) echo {' '.join(words)} ;;" for one, words in second.items() if words]
    told = "|".join(f'"{" ".join(name)}"' for name in pairs)
    return _SCRIPT % {"first": " ".join(first), "pairs": told, "seconds": "\n".join(lines)}

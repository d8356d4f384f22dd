#!/bin/sh
# SPDX-License-Identifier: BSD-3-Clause
# tools/workspace.sh COMMAND ...: finds a Python of a supported version and runs tools/workspace with it.
# PYTHON=/path/to/python3 chooses one.
set -u
tools=$(CDPATH='' cd -- "$(dirname -- "$0")" && pwd) || exit 1

# The wheels are tested with Python 3.11 and 3.12. A sourced ROS has its own, up to 3.14 (ROS 2 Lyrical).
newest=12
[ -z "${ROS_DISTRO:-}" ] || [ -n "${ROS_WHEELS:-}${_ROS_WHEELS_BOOTSTRAP_COMPLETE:-}" ] || newest=14

# Prints the interpreter behind a name (behind a version manager's shim, behind an activated virtual environment),
# when it is of a supported version. With a second argument: only when it can also make virtual environments.
probe() {
  "$1" -E -c 'import sys
if not (3, 11) <= sys.version_info[:2] <= (3, int(sys.argv[1])): sys.exit(1)
if len(sys.argv) > 2: import ensurepip, venv
print(getattr(sys, "_base_executable", "") or sys.executable)' "$newest" ${2:+"$2"} 2>/dev/null
}

if [ -n "${PYTHON:-}" ]; then
  python=$(probe "$PYTHON") || {
    printf 'error: PYTHON=%s is not a Python 3.11 to 3.%s: %s\n' "$PYTHON" "$newest" "$("$PYTHON" -V 2>&1)" >&2
    printf 'remedy: name another, or none to have one searched for\n' >&2
    exit 1
  }
else
  candidates='python3 python3.12 python3.11 /usr/bin/python3'
  python=
  for candidate in $candidates; do python=$(probe "$candidate" with-venv) && break; done
  [ -n "$python" ] || for candidate in $candidates; do python=$(probe "$candidate") && break; done
  if [ -z "$python" ]; then
    printf 'error: no Python 3.11 to 3.%s was found.\n' "$newest" >&2
    for candidate in $candidates; do
      version=$("$candidate" -V 2>&1) && printf '  %s is %s\n' "$candidate" "$version" >&2
    done
    printf 'remedy: sudo apt-get install python3 python3-venv python3-dev   (Debian 12: 3.11; Ubuntu 24.04: 3.12)\n' >&2
    printf '        or name one that you have: make setup PYTHON=/path/to/python3.12\n' >&2
    exit 1
  fi
fi
exec "$python" -E "$tools/workspace" "$@"

# SPDX-License-Identifier: BSD-3-Clause
# shellcheck shell=sh
# To be sourced, after `make setup`:   . tools/env.sh
# Gives this shell (bash, zsh; sh when in the root of the workspace) what the workspace installs: Python imports, the executables by
# their names (bt_server, console, ...), colcon, and ROS 2 settings for one computer. What is set already stays as it is.
# ROS_WHEELS=kilted chooses what `make setup ROS_WHEELS=kilted` has made.

# Where this file is: bash and zsh tell; other shells have to be in the workspace, or set FLEXBT_ROOT.
if [ -n "${BASH_VERSION:-}" ]; then
  # shellcheck disable=SC3028,SC3054
  FLEXBT_ROOT=$(CDPATH='' cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd)
elif [ -n "${ZSH_VERSION:-}" ]; then
  FLEXBT_ROOT=$(eval 'CDPATH="" cd -- "${${(%):-%x}:A:h:h}" && pwd')
else
  FLEXBT_ROOT=${FLEXBT_ROOT:-$PWD}
fi

# The wheels of another distribution than the default have a place of their own.
case ${ROS_WHEELS:-jazzy} in
  jazzy) _flexbt_spaces=$FLEXBT_ROOT ;;
  *) _flexbt_spaces=$FLEXBT_ROOT/.$ROS_WHEELS ;;
esac

if [ ! -f "$FLEXBT_ROOT/tools/env.sh" ]; then
  echo "error: '$FLEXBT_ROOT' is not the workspace: cd to it, or set FLEXBT_ROOT to it, before sourcing tools/env.sh" >&2
  unset FLEXBT_ROOT
  false
elif [ ! -f "$_flexbt_spaces/install/local_setup.sh" ] || [ ! -f "$_flexbt_spaces/install/flexbt_underlay.sh" ]; then
  echo "error: the workspace is not built yet: run 'make setup${ROS_WHEELS:+ ROS_WHEELS=$ROS_WHEELS}' in $FLEXBT_ROOT" >&2
  false
# A build refers to its place: a copy of the workspace would run what is in the original.
elif _flexbt_place=$(sed -n '1s/^# built in //p' "$_flexbt_spaces/install/flexbt_underlay.sh") &&
  [ -n "$_flexbt_place" ] && [ "$_flexbt_place" != "$(CDPATH='' cd -- "$FLEXBT_ROOT" && pwd -P)" ]; then
  echo "error: this is a copy of $_flexbt_place, or was moved from there:" \
    "run 'make setup${ROS_WHEELS:+ ROS_WHEELS=$ROS_WHEELS}' in $FLEXBT_ROOT" >&2
  unset _flexbt_place
  false
elif [ -n "${ROS_WHEELS:-}" ] && [ "${ROS_DISTRO:-$ROS_WHEELS}" != "$ROS_WHEELS" ]; then
  echo "error: ROS 2 $ROS_DISTRO is sourced in this shell: use a new one for ROS_WHEELS=$ROS_WHEELS" >&2
  false
else
  export FLEXBT_ROOT
  [ -z "${ROS_WHEELS:-}" ] || export ROS_WHEELS
  # The scripts of colcon and of ROS 2 cannot be sourced under `set -u`.
  _flexbt_options=$-
  set +u
  _flexbt_middleware=${RMW_IMPLEMENTATION:-}
  # shellcheck disable=SC1091
  . "$_flexbt_spaces/install/flexbt_underlay.sh"
  if [ -n "${BASH_VERSION:-}" ]; then
    # shellcheck disable=SC1091
    . "$_flexbt_spaces/install/local_setup.bash"
  elif [ -n "${ZSH_VERSION:-}" ]; then
    # shellcheck disable=SC1091
    . "$_flexbt_spaces/install/local_setup.zsh"
  else
    # shellcheck disable=SC1091
    . "$_flexbt_spaces/install/local_setup.sh"
  fi

  # The set-up of the wheels names the middleware that they bring; a choice made before stays.
  [ -z "$_flexbt_middleware" ] || export RMW_IMPLEMENTATION="$_flexbt_middleware"

  case $_flexbt_options in *u*) set -u ;; esac

  # The executables of a package are in install/PACKAGE/lib/PACKAGE.
  for _flexbt_directory in "$_flexbt_spaces"/install/*/lib/flexbt_*; do
    case ":$PATH:" in
      *":$_flexbt_directory:"*) ;;
      *) [ ! -d "$_flexbt_directory" ] || PATH=$_flexbt_directory:$PATH ;;
    esac
  done
  export PATH
  unset _flexbt_directory _flexbt_options _flexbt_middleware

  # Unless told otherwise, only this computer; quick discovery (see flexbt_common/discovery.py); logs beside the others of the workspace.
  if [ "${RMW_IMPLEMENTATION:-rmw_fastrtps_cpp}" = rmw_fastrtps_cpp ]; then
    case ${_flexbt_fastdds:-2} in
      2) _flexbt_variable=FASTRTPS_DEFAULT_PROFILES_FILE _flexbt_config=$FLEXBT_ROOT/flexbt_common/config ;;
      *) _flexbt_variable=FASTDDS_DEFAULT_PROFILES_FILE _flexbt_config=$FLEXBT_ROOT/flexbt_common/config/fastdds3 ;;
    esac
    eval "_flexbt_profile=\${$_flexbt_variable:-}"
    if [ -z "${ROS_AUTOMATIC_DISCOVERY_RANGE:-}$_flexbt_profile" ]; then
      ROS_AUTOMATIC_DISCOVERY_RANGE=SYSTEM_DEFAULT
      _flexbt_profile=$_flexbt_config/this_computer.xml
    fi
    export "$_flexbt_variable=${_flexbt_profile:-$_flexbt_config/network.xml}"
  fi
  export ROS_AUTOMATIC_DISCOVERY_RANGE="${ROS_AUTOMATIC_DISCOVERY_RANGE:-LOCALHOST}"
  # Where neither the workspace nor the home directory can be written, no node would start.
  if [ -w "$FLEXBT_ROOT" ]; then
    export ROS_LOG_DIR="${ROS_LOG_DIR:-$_flexbt_spaces/log/ros}"
  elif [ ! -w "${HOME:-/nowhere}" ] && [ -z "${ROS_HOME:-}" ]; then
    export ROS_LOG_DIR="${ROS_LOG_DIR:-${TMPDIR:-/tmp}/flexbt-$(id -u)/log}"
  fi
  unset _flexbt_spaces _flexbt_place _flexbt_fastdds _flexbt_variable _flexbt_config _flexbt_profile
fi

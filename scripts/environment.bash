# Sourced by the scripts: select_environment makes .venv in the checkout if necessary, and activates it.

root=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd -P)
venv=$root/.venv
python=${HEAD_TRACKING_PYTHON:-python3}

say() { printf 'head_tracking: %s\n' "$*" >&2; }

die() {
  say "$@"
  exit 1
}

checksum() { (cd -- "$root" && cat -- "$@" | sha256sum | cut -c -16); }

install() { "$venv/bin/python" -m pip --disable-pip-version-check install -qq "$@"; }

# Everything on which the environment depends, as one key.
surroundings() {
  local path
  [[ ${VIRTUAL_ENV:-} != "$venv" ]] || PATH=${PATH#"$venv/bin:"} # not the Python of .venv, if it is active
  path=$(type -P "$python") || die "$python is not installed. Install Python 3.10 to 3.13, or choose" \
    "another with HEAD_TRACKING_PYTHON, for example HEAD_TRACKING_PYTHON=python3.12."
  printf '%s|' "$(checksum setup.py pyproject.toml requirements/{libraries,yourdfpy,ros}.txt)" "$root" \
    "$(readlink -f -- "$path")" "${PYENV_VERSION:-}" "${ROS_DISTRO:-}"
}

make_environment() {
  local probe version interpreter ros="ROS 2 Jazzy as wheels" numpy=numpy site=()
  probe=$("$python" -c 'import os, sys; print("%d.%d" % sys.version_info[:2],
  os.path.realpath(getattr(sys, "_base_executable", sys.executable)))') ||
    die "$python does not start (see above). Choose another with HEAD_TRACKING_PYTHON."
  read -r version interpreter <<<"$probe"
  # 3.14 is the Python of ROS 2 Lyrical; without a sourced ROS it is not supported.
  [[ $version == 3.1[0123] || ($version == 3.14 && -n ${ROS_DISTRO:-}) ]] ||
    die "$python is Python $version; head_tracking needs 3.10 to 3.13. Choose another with" \
      "HEAD_TRACKING_PYTHON, for example HEAD_TRACKING_PYTHON=python3.12."
  # This variable disables the bootstrap of the ROS wheels, so that only a system ROS is found.
  if probe=$(_ROS_WHEELS_BOOTSTRAP_COMPLETE=1 "$interpreter" -c 'import rclpy, sensor_msgs.msg, numpy
print("numpy<%d" % (int(numpy.__version__.split(".")[0]) + 1))' 2>&1); then
    ros="the system's ROS 2" numpy=${probe##*$'\n'} site=(--system-site-packages)
  elif [[ -n ${ROS_DISTRO:-} ]]; then
    die "ROS 2 ${ROS_DISTRO^} is sourced, but $interpreter (Python $version) cannot load its rclpy" \
      "(${probe##*$'\n'}). Choose ROS's own Python (HEAD_TRACKING_PYTHON=/usr/bin/python3 on" \
      "Ubuntu), or start from a terminal where ROS is not sourced."
  elif [[ $(uname -sm) != "Linux x86_64" ]]; then
    die "No ROS 2 is sourced, and its wheels exist only for Linux on x86-64 (this is $(uname -sm))." \
      "Install ROS 2 Jazzy from its packages for Ubuntu 24.04, source it and start again."
  fi
  "$interpreter" -c 'import ensurepip, venv' 2>/dev/null ||
    die "$interpreter cannot make virtual environments: apt install python3-venv (or" \
      "python$version-venv), and start again."
  [[ ! -e $venv || -e $venv/head_tracking.base ]] ||
    die "$venv was not made by this script. Delete it or move it away, and start again."
  [[ ! -e $venv/head_tracking.in-use ]] || flock -n "$venv/head_tracking.in-use" true ||
    die "$venv must be rebuilt (Python, ROS or the requirements changed), but a program from this" \
      "checkout still uses it. End that program and start again."
  say "setting up .venv, once: Python $version, $ros (up to 70 MB to download, 280 MB on disk)"
  rm -rf -- "$venv"
  mkdir -- "$venv"
  : >"$venv/head_tracking.base"
  trap 'say "the set-up failed (it needs the network); the next start repeats it"' EXIT
  "$interpreter" -m venv ${site[@]+"${site[@]}"} "$venv"
  # The numpy with which the C extensions of ROS were built is installed first.
  ((${#site[@]})) || install -r "$root/requirements/ros.txt"
  install "$numpy" -r "$root/requirements/libraries.txt"
  install --no-deps -r "$root/requirements/yourdfpy.txt" -e "$root"
  "$venv/bin/python" -c 'import numpy, rclpy, sensor_msgs.msg, serial, xacro, yaml, yourdfpy'
  : >"$venv/head_tracking.in-use"
  trap - EXIT
}

# add NAME SIZE LIST...: installs lists of requirements, unless the stamp NAME shows that they are.
add() {
  local stamp=$venv/head_tracking.$1 lists=("${@:3}") now
  now=$(checksum "${lists[@]/#/requirements/}")
  if [[ -e $stamp && $(<"$stamp") == "$now" ]]; then return; fi
  say "adding ${lists[*]%.txt} to .venv, once ($2 to download)"
  # Keep the numpy with which the C extensions of ROS were built.
  install "${lists[@]/#/-r$root/requirements/}" \
    -c <("$venv/bin/python" -c 'import numpy; print("numpy==" + numpy.__version__)') || return
  if [[ $1 == test ]]; then
    "$venv/bin/python" "$root/test/support/photographs.py" || say "photographs are missing: their tests are skipped"
  fi
  printf '%s\n' "$now" >"$stamp"
}

add_opencv() { add vision "70 MB" vision.txt; }
add_viewer() { add viewer "25 MB" viewer.txt; }
add_contenders() { add benchmark "60 MB" benchmark.txt; }

# select_environment run|test
select_environment() {
  local now wheels=
  local -x PYTHONSAFEPATH=1 # do not import from the working directory
  [[ ${ROS_DISTRO:-jazzy} == jazzy ]] ||
    say "ROS 2 ${ROS_DISTRO^} is sourced; head_tracking is tested with Jazzy only."
  if [[ -n ${_ROS_WHEELS_BOOTSTRAP_COMPLETE:-} ]]; then
    # Set by another environment with ROS wheels; .venv must find its own libraries.
    unset _ROS_WHEELS_BOOTSTRAP_COMPLETE LD_LIBRARY_PATH
  fi
  now=$(surroundings)
  is_made() { [[ -e $venv/head_tracking.base && $(<"$venv/head_tracking.base") == "$now"* ]]; }
  if ! is_made; then # a read-only checkout must have a complete .venv
    exec 8>>"$root/.venv.lock"
    flock 8
    if ! is_made; then
      make_environment
      printf '%s\n' "$now" >"$venv/head_tracking.base"
    fi
    exec 8>&-
  fi
  if compgen -G "$venv/lib/python3*/site-packages/rclpy" >/dev/null; then wheels=yes; fi
  if [[ $1 == test ]]; then
    # pip uses one core and waits for the network: the compiler can work beside it.
    [[ -z $wheels ]] || "$venv/bin/python" "$root/test/messages/build.py" "$venv/messages" &
    add test "160 MB" test.txt vision.txt viewer.txt
    wait
  fi
  exec 9<"$venv/head_tracking.in-use"
  flock -s 9

  export VIRTUAL_ENV=$venv PATH=$venv/bin:$PATH
  # First on the path, before an installed copy in a sourced workspace.
  export PYTHONPATH=$root${PYTHONPATH:+:$PYTHONPATH}
  if [[ $wheels ]]; then
    export AMENT_PREFIX_PATH=$venv
    if [[ $1 == test ]]; then
      export LD_LIBRARY_PATH=$venv/messages/lib${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}
      PYTHONPATH+=:$(echo "$venv"/messages/lib/python3*/site-packages)
    fi
  fi
}

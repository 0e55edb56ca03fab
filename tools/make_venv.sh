#!/bin/sh
# Make the virtual environment for tests and demo.
#
#   tools/make_venv.sh FOLDER newest|oldest
#
# Uses the Python in $PYTHON, or the first of python3.12, python3.11, python3 that is 3.11 or
# 3.12. A sourced ROS 2 (Jazzy, Kilted or Rolling) is used as it is; otherwise the wheels of Jazzy
# are installed.
# A second call without changes returns at once.
set -eu

venv=$1
set_name=$2
cd "$(dirname "$0")/.."
here=$(pwd)

fail() {
    echo "make: $*" >&2
    exit 1
}

version_of() {
    "$1" -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null || true
}

# Sets $python and $version.
choose_python() {
    if [ -n "${PYTHON:-}" ]; then
        python=$(command -v "$PYTHON") || fail "PYTHON=$PYTHON: no such program"
        version=$(version_of "$python")
        case $version in
            3.11 | 3.12) return ;;
            '') fail "PYTHON=$PYTHON does not run as a Python" ;;
            *) fail "PYTHON=$PYTHON is Python $version; Python 3.11 or 3.12 is needed" ;;
        esac
    fi
    seen=
    for name in $1; do
        python=$(command -v "$name") || continue
        version=$(version_of "$python")
        case $version in
            3.11 | 3.12) return ;;
            ?*) seen="$seen$name is $version, " ;;
        esac
    done
    fail "no Python 3.11 or 3.12 found (${seen:-no python3 on PATH, }which is not enough):" \
        "install one, or name it with PYTHON=/path/to/python3.12"
}

# Sets $ros to 'sourced' or 'wheels'.
choose_ros() {
    case ${ROS_DISTRO:-none} in
        jazzy | kilted | rolling)
            choose_python 'python3 python3.12'
            if "$python" -c 'import rclpy' 2>/dev/null; then
                ros=sourced
                set_name=oldest
                return
            fi
            fail "ROS_DISTRO is $ROS_DISTRO but $python cannot import rclpy: source" \
                "/opt/ros/$ROS_DISTRO/setup.sh, or unset ROS_DISTRO to use the wheels"
            ;;
        none)
            choose_python 'python3.12 python3.11 python3'
            ros=wheels
            ;;
        *) fail "ROS 2 $ROS_DISTRO is sourced and this package is for Jazzy, Kilted and Rolling:" \
            "use a shell in which it is not sourced" ;;
    esac
}

check_venv_module() {
    "$python" -c 'import venv, ensurepip' 2>/dev/null ||
        fail "$python has no venv module: sudo apt install python$version-venv"
}

fingerprint() {
    { cat requirements/*.txt setup.py tools/make_venv.sh
      echo "$here $venv $set_name $ros $python $version"; } | cksum | tr ' ' '-'
}

install() {
    pip="$venv/bin/python -m pip --disable-pip-version-check -qq"
    if [ "$ros" = sourced ]; then
        "$python" -m venv --clear --system-site-packages "$venv"
        files="-r requirements/$set_name.txt"
    else
        "$python" -m venv --clear "$venv"
        files="-r requirements/$set_name.txt -r requirements/ros.txt"
    fi
    # shellcheck disable=SC2086
    $pip install $files || fail "installing failed: pip's message is above"
    $pip install --no-deps --no-build-isolation --editable . ||
        fail "installing this package failed: pip's message is above"
    "$venv/bin/python" -c 'import rclpy, numpy, scipy, pinocchio' ||
        fail "the packages installed into $venv do not import"
}

choose_ros
stamp="$venv/.made-$(fingerprint)"
if [ -e "$stamp" ] && "$venv/bin/python" -c '' 2>/dev/null; then
    exit 0
fi
check_venv_module
if [ "$ros" = sourced ]; then
    echo "Using the sourced ROS 2 $ROS_DISTRO and its Python $version ($python)." >&2
else
    echo "No ROS sourced: installing the ROS 2 Jazzy wheels for Python $version ($python)." >&2
fi
echo "Making $venv with the $set_name requirements; the first time takes a minute or two." >&2
install
touch "$stamp"

# Set-up shared by the programs in scripts/; meant to be sourced, after
# `set -euo pipefail`.
#
# Everything stays inside the project (.venv/, build/) but the system packages, and what is there
# already is left alone: a second run costs seconds. Works on Debian 12 and Ubuntu 24.04, as root or
# with sudo.

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
cd "$root"
logs=$root/build/logs
mkdir -p "$logs"
export PYTHONDONTWRITEBYTECODE=  # many processes import the same: Python compiles it once
SECONDS=0

say() { printf '[%4d s] %s\n' "$SECONDS" "$*"; }

fail() {
  printf 'error: %s\n' "$*" >&2
  exit 1
}

# quietly NAME COMMAND...: output goes to build/logs/NAME.log; its end is shown on failure.
quietly() {
  local log=$logs/$1.log
  shift
  if ! "$@" >"$log" 2>&1 </dev/null; then
    tail -n 40 "$log" >&2
    fail "'$*' failed (all of its output: ${log#"$root"/})"
  fi
}

as_root() {
  if [ "$(id -u)" = 0 ]; then
    "$@"
  elif command -v sudo >/dev/null; then
    sudo "$@"
  else
    fail "'$*' needs root or sudo"
  fi
}

apt_update() { # once per run
  if [ -z "${apt_updated:-}" ]; then
    command -v apt-get >/dev/null || fail "no apt-get here: install the packages of scripts/lib/setup.sh yourself"
    quietly apt-update as_root apt-get -qq update
    apt_updated=yes
  fi
}

# apt_install PACKAGE...: nothing happens without a package.
apt_install() {
  [ $# -gt 0 ] || return 0
  say "system packages: $*"
  apt_update
  quietly apt-install as_root env DEBIAN_FRONTEND=noninteractive \
    apt-get -qq install -y --no-install-recommends "$@"
}

# ensure_system [test]: compiler, CMake, headers, Python; with `test` also GoogleTest, what the
# importer ecos and PDF files need, and Wine if DOCKLOOP_PLATFORMS has win64.
ensure_system() {
  local missing=()
  command -v g++ >/dev/null || missing+=(g++)
  command -v cmake >/dev/null || missing+=(cmake)
  command -v ninja >/dev/null || missing+=(ninja-build)
  [ -d /usr/include/eigen3/Eigen ] || missing+=(libeigen3-dev)
  [ -f /usr/include/nlohmann/json.hpp ] || missing+=(nlohmann-json3-dev)
  command -v python3 >/dev/null || missing+=(python3)
  python3 -c 'import ensurepip, venv' 2>/dev/null || missing+=(python3-venv)
  [ -f "$(python3 -c 'import sysconfig; print(sysconfig.get_path("include"))' 2>/dev/null)/Python.h" ] ||
    missing+=(python3-dev)
  if [ "${1:-}" = test ]; then
    [ -f /usr/include/gtest/gtest.h ] || missing+=(libgtest-dev)
    [ -e "/usr/lib/$(uname -m)-linux-gnu/libtbb.so.12" ] || missing+=(libtbb12)
    [ -e "/usr/lib/$(uname -m)-linux-gnu/libpangoft2-1.0.so.0" ] || missing+=(libpangoft2-1.0-0)
    [ -e "/usr/lib/$(uname -m)-linux-gnu/libharfbuzz-subset.so.0" ] || missing+=(libharfbuzz-subset0)
    if [[ " ${DOCKLOOP_PLATFORMS:-} " = *" win64 "* ]]; then
      [ -x /usr/lib/wine/wine64 ] || missing+=(wine64)
    fi
  fi
  apt_install "${missing[@]}"
  python3 -c 'import sys; sys.exit(sys.version_info < (3, 11))' || fail "Python 3.11 or newer is needed"
}

# ensure_browser: Chromium, in which the pages of `dockloop view` are tested, and ffmpeg for films.
# Ubuntu has no such Debian package chromium (but a snap): there the tests are skipped.
ensure_browser() {
  local missing=()
  command -v ffmpeg >/dev/null || missing+=(ffmpeg)
  if [ -z "${DOCKLOOP_BROWSER:-}" ] &&
    ! command -v chromium chromium-browser google-chrome google-chrome-stable chrome >/dev/null; then
    apt_update
    apt-cache show chromium >/dev/null 2>&1 || { say "no package chromium: tests in a browser are skipped"; return; }
    missing+=(chromium)
  fi
  apt_install "${missing[@]}"
}

# SUNDIALS: headers and static archives of the Debian package, unpacked, not installed. Installing it
# would drag PETSc, hypre, MPI and a Fortran compiler (hundreds of MB); unpacked it is about 1 MB here.
ensure_sundials() {
  local target=$root/build/deps/sundials
  compgen -G "$target/usr/lib/*/libsundials_ida.a" >/dev/null && return
  say "SUNDIALS: headers and static libraries into build/deps"
  local work=$root/build/deps/download
  rm -rf "$work" "$target"
  mkdir -p "$work" "$target"
  (cd "$work" && quietly sundials-download apt-get -qq download -o APT::Sandbox::User=root libsundials-dev) 2>/dev/null || {
    apt_update
    (cd "$work" && quietly sundials-download apt-get -qq download -o APT::Sandbox::User=root libsundials-dev)
  }
  quietly sundials-unpack dpkg -x "$work"/libsundials-dev_*.deb "$work/unpacked"
  (
    cd "$work/unpacked"
    find usr/include/{cvode,ida,nvector,sun*} -name '*.h*' -exec cp --parents {} "$target" \;
    find usr/lib \( -name 'libsundials_cvode.a' -o -name 'libsundials_ida.a' \
      -o -name 'libsundials_nvecserial.a' -o -name 'libsundials_generic.a' \) -exec cp --parents {} "$target" \;
    cp --parents usr/share/doc/libsundials-dev/copyright "$target"
  )
  rm -rf "$work"
}

# The sources of Eigen, nlohmann-json and SUNDIALS in build/deps/source (see sources.cmake), from
# which portable binaries are compiled. SUNDIALS has the version of the package libsundials-dev.
ensure_sources() {
  local target=$root/build/deps/source key
  key=$(sha256sum <scripts/lib/sources.cmake)
  [ "$(cat "$target.key" 2>/dev/null)" = "$key" ] && return
  say "sources of Eigen, nlohmann-json and SUNDIALS into build/deps"
  local work=$root/build/deps/download uri suite component
  rm -rf "$work"
  mkdir -p "$work/lists/partial"
  [ -n "$(apt-cache madison libsundials-dev 2>/dev/null)" ] || apt_update
  read -r uri suite < <(apt-cache madison libsundials-dev | awk -F '|' 'NR == 1 {print $3}')
  component=${suite#*/} component=${component%% *} suite=${suite%%/*}
  echo "deb-src $uri $suite $component" >"$work/sources.list"  # of this folder, not of the system
  local apt=(apt-get -qq -o "Dir::Etc::SourceList=$work/sources.list" -o Dir::Etc::SourceParts=-
    -o "Dir::State::Lists=$work/lists" -o APT::Sandbox::User=root)
  quietly sources-list "${apt[@]}" update
  (cd "$work" && quietly sources-download "${apt[@]}" source --download-only sundials)
  quietly sources-unpack cmake "-DARCHIVE=$(ls "$work"/sundials_*.orig.tar.*)" "-DTARGET=$target" \
    -P scripts/lib/sources.cmake
  echo "$key" >"$target.key"
  rm -rf "$work"
}

# The Pythons of Linux, macOS and Windows in build/deps/python: headers for the modules of wheels, the
# import library of Windows, and interpreters to test wheels with (tests/test_wheels.py). Debian has
# none of another system, and the wheels of PyPI have no headers. Maven Central has all of them, as
# parts of JavaCPP. One set serves both processors of a system: the stable ABI is the same.
ensure_foreign_pythons() {
  local target=$root/build/deps/python version=3.12.1-1.5.10 system
  [ "$(cat "$target/version" 2>/dev/null)" = "$version" ] && return
  say "Pythons of Linux, macOS and Windows into build/deps"
  command -v mvn >/dev/null || apt_install maven
  local work=$root/build/deps/download
  rm -rf "$work" "$target"
  mkdir -p "$work" "$target"
  for system in linux macosx windows; do
    quietly "python-$system" mvn -q -B "-Dmaven.repo.local=$work/maven" dependency:copy \
      "-Dartifact=org.bytedeco:cpython:$version:jar:$system-x86_64" "-DoutputDirectory=$work"
    (cd "$work" && cmake -E tar xf "cpython-$version-$system-x86_64.jar")
    mv "$work/org/bytedeco/cpython/$system-x86_64" "$target/$system"
    [ $system = windows ] || mv "$target/$system/include/python3.12"/* "$target/$system/include/"
  done
  rm -rf "$target"/*/lib/python3.12/test "$target"/windows/lib/test "$target"/macosx/lib
  chmod +x "$target/linux/bin/python3.12"
  echo "$version" >"$target/version"
  rm -rf "$work"
}

# ensure_python [platforms|site|test]: .venv with this package (editable), and with .venv/bin/dockloop.
# Python compiles what it imports; most of what pip would compile is never used.
ensure_python() {
  local extra=${1:-} key stamp
  key=$(cat pyproject.toml scripts/lib/setup.sh <(echo "$root") | sha256sum | cut -c 1-16)
  stamp=.venv/.dockloop-$key
  [ -x .venv/bin/dockloop ] && { [ -f "$stamp-test" ] || [ -f "$stamp-$extra" ]; } && return
  say "Python packages into .venv"
  [ -x .venv/bin/python ] || quietly venv python3 -m venv .venv
  quietly pip .venv/bin/python -m pip install --disable-pip-version-check --no-input --no-compile \
    -e ".[build${extra:+,$extra}]"
  touch "$stamp-$extra"
}

# compile [test]: the module of the Python package and the library of the FMU, in build/release; with
# `test` everything. The methods for comparison and the generator of kernels are compiled when a
# command asks for them (compiled.py).
compile() {
  local tests=OFF
  [ "${1:-}" = test ] && tests=ON
  # CMake refuses the files of a clone that was moved.
  grep -qs "^CMAKE_CACHEFILE_DIR:INTERNAL=$root/build/release$" build/release/CMakeCache.txt ||
    rm -rf build/release/CMakeCache.txt build/release/CMakeFiles build/release/build.ninja
  if [ ! -f build/release/build.ninja ] || { [ $tests = ON ] &&
    ! grep -q 'DOCKLOOP_TESTS:BOOL=ON' build/release/CMakeCache.txt; }; then
    say "configure"
    # Several files at a time take half the time of all by themselves, but one that changed takes its
    # neighbours along: for work on the core configure with -DCMAKE_UNITY_BUILD=OFF.
    quietly configure cmake --preset release -DDOCKLOOP_TESTS=$tests -DDOCKLOOP_WERROR=$tests \
      -DCMAKE_UNITY_BUILD=${DOCKLOOP_UNITY:-ON}
  fi
  say "compile (build/logs/compile.log)"
  if [ $tests = ON ]; then
    quietly compile cmake --build --preset release
  else
    quietly compile cmake --build --preset release --target _core dockloop_fmu
  fi
}

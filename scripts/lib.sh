# Functions of the scripts in this folder: packages, builds, and those of children.sh. Source this file. It needs bash,
# coreutils and, to install packages, apt.

source "$(dirname "${BASH_SOURCE[0]}")/children.sh"
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)

# ---- packages ----

# packages SECTION...: prints the packages in these sections of packages.txt.
packages() {
  local wanted=" $* " section='' line
  while read -r line; do
    line=${line%%#*}
    line=${line#"${line%%[![:space:]]*}"}
    line=${line%"${line##*[![:space:]]}"}
    case $line in
      '') ;;
      '['*']') section=${line:1:-1} ;;
      *) [[ $wanted == *" $section "* ]] && printf '%s\n' "$line" ;;
    esac
  done <"$root/scripts/packages.txt"
  return 0
}

# ensure_packages SECTION...: installs missing packages, as root or through sudo.
ensure_packages() {
  local name status log="$root/build/install.log"
  local -a missing=() as_root=()
  if ! command -v dpkg-query >/dev/null; then
    say "no dpkg on this machine: assuming that the packages of scripts/packages.txt [$*] are installed"
    return 0
  fi
  while read -r name; do
    status=$(dpkg-query -W -f '${db:Status-Abbrev}' "$name" 2>/dev/null || true)
    [[ $status == ii* ]] || missing+=("$name")
  done < <(packages "$@")
  [[ ${#missing[@]} -gt 0 ]] || return 0
  if [[ $EUID -ne 0 ]]; then
    command -v sudo >/dev/null || fail "these Debian packages are missing and need root or sudo to install: ${missing[*]}"
    as_root=(sudo)
  fi
  say "downloading ${#missing[@]} Debian packages and their dependencies: ${missing[*]}"
  mkdir -p "$root/build"
  local -a install=("${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -q -y --no-install-recommends)
  # These commands run in the foreground, because sudo may ask for a password, and an interrupted dpkg should finish its
  # step. By default dpkg flushes every file, which takes most of the time. One sync at the end is enough.
  if ! {
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive dpkg --configure -a &&
      "${as_root[@]}" apt-get update -q &&
      "${install[@]}" --download-only "${missing[@]}" &&
      say "installing them" 2>&3 &&
      "${install[@]}" -o Dpkg::Options::=--force-unsafe-io "${missing[@]}" &&
      sync
  } 3>&2 >"$log" 2>&1; then
    tail -n 15 "$log" >&2
    fail "could not install packages; the whole output is in $log"
  fi
  say "packages installed"
}

# npm_registry: prints the address of the npm registry on a machine without npm. This is the variable
# npm_config_registry, or else the default in Debian's package of npm, which is fetched (0.7 MB) but not installed.
npm_registry() {
  local folder
  if [[ -n ${npm_config_registry:-} ]]; then
    printf '%s\n' "$npm_config_registry"
    return 0
  fi
  folder=$(mktemp -d)
  (
    cd "$folder"
    apt-get download -q npm >/dev/null 2>&1
    dpkg-deb --fsys-tarfile npm_*.deb | tar -x --to-stdout --wildcards '*/config/definitions.js' |
      sed -n "s/^ *default: '\(https:[^']*\)',\$/\1/p" | sed -n 1p
  ) || true
  rm -rf "$folder"
}

# fetch_npm SOURCE NAME: fetches the packages of SOURCE/package-lock.json into build/NAME/node_modules, unless they are
# there. Returns 1 if this fails.
fetch_npm() {
  local source=$1 folder="$root/build/$2" log="$root/build/$2.log"
  if cmp -s "$source/package-lock.json" "$folder/fetched-lock.json"; then return 0; fi
  say "fetching npm packages"
  rm -rf "$folder"
  mkdir -p "$folder"
  cp "$source/package.json" "$source/package-lock.json" "$root/.npmrc" "$folder"
  if {
    if command -v npm >/dev/null; then
      run npm ci --prefix "$folder" --ignore-scripts --no-audit --no-fund
    else
      run node "$root/scripts/fetch-npm.js" "$(npm_registry)" "$source/package-lock.json" "$folder"
    fi
  } >"$log" 2>&1; then
    cp "$source/package-lock.json" "$folder/fetched-lock.json"
  else
    tail -n 3 "$log" >&2
    return 1
  fi
}

# ensure_npm: fetches the packages of the tests. If this fails, the tests that need them are skipped with a reason.
ensure_npm() {
  fetch_npm "$root" npm || say "no npm packages: the tests that read recordings with them are skipped"
}

# ---- build ----

# Prints the number of parallel compilers: one for each processor, but no more than fit into memory. For generated DDS
# code a compiler takes over 1 GB.
build_jobs() {
  local processors key kilobytes
  processors=$(nproc)
  while read -r key kilobytes _; do
    [[ $key == MemAvailable: ]] || continue
    local fitting=$((kilobytes / 1500000))
    ((fitting < 1)) && fitting=1
    ((processors > fitting)) && processors=$fitting
  done </proc/meminfo
  printf '%s\n' "$processors"
}

# build PRESET "CMAKE OPTIONS" [TARGET...]: configures and builds into build/PRESET. Warnings are errors only in CI.
build() {
  local preset=$1 log="$root/build/configure-$1.log"
  local -a options
  read -r -a options <<<"$2"
  shift 2
  [[ -n ${CI:-} ]] && options+=(-DTACTUS_WERROR=ON) || options+=(-DTACTUS_WERROR=OFF)
  command -v ccache >/dev/null && options+=(-DCMAKE_CXX_COMPILER_LAUNCHER=ccache)
  mkdir -p "$root/build"
  cd "$root"
  say "configuring preset $preset"
  if ! run cmake --preset "$preset" "${options[@]}" >"$log" 2>&1; then
    tail -n 25 "$log" >&2
    fail "cmake refused the configuration; the whole output is in $log"
  fi
  say "building preset $preset with $(build_jobs) compilers"
  run ninja -C "build/$preset" -j "$(build_jobs)" "$@" >&2 || fail "the build failed"
  say "built"
}

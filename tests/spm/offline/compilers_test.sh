#!/usr/bin/env bash
# Usage: compilers_test.sh SOURCE BUILD PROGRAM
# Builds PROGRAM in BUILD with its compiler, and a second time with clang++. Runs both programs. Their model files must
# have the same bytes. Exit status 77: skipped.
set -euo pipefail
if ! clang=$(command -v clang++ || command -v clang++-14); then
  echo 'skipped: no clang++ (Debian: clang)'
  exit 77
fi
work="$2/compilers"
mkdir -p "$work"
cmake --build "$2" --target spm_offline_build_files >"$work/build.log"
cmake --preset release -S "$1" -B "$work/clang" -DCMAKE_CXX_COMPILER="$clang" -DCMAKE_CXX_FLAGS_RELEASE='-O1 -DNDEBUG' \
  -DTACTUS_MODULES='spm;spm/codec;spm/offline;spm/fcl' >"$work/configure.log"
cmake --build "$work/clang" --target spm_offline_build_files >"$work/build.log"
rm -rf "$work/models" "$work/clang_models"
"$3" "$work/models"
"$work/clang/${3#"$2"/}" "$work/clang_models"
diff -r "$work/models" "$work/clang_models"
[[ $(find "$work/models" -type f | wc -l) -eq 4 ]]

#!/usr/bin/env bash
# Usage: compilers_test.sh PROGRAM OTHER-PROGRAM FOLDER. Both write files; they have to be the same to the byte.
set -euo pipefail
rm -rf "$3"
"$1" "$3/ours"
"$2" "$3/other"
diff -r "$3/ours" "$3/other"
[[ $(ls "$3/ours" | wc -l) -eq 4 ]]

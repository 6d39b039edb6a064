#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
#
# The lint lane: the format of every C++ source, a build by clang with its warnings and its thread-safety
# analysis as errors, then clang-tidy. Installs what is missing. Not part of deploy/test.sh: clang-tidy
# takes several times as long as the compiler.
#
#   deploy/lint.sh                 everything
#   deploy/lint.sh --format        the format alone
#   deploy/lint.sh --fix           rewrites the files into the format, and stops
#   deploy/lint.sh FILE.cc...      clang-tidy on these files alone
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

deploy/install_packages.sh build test bench lint

mapfile -t sources < <(find client core server tests -name '*.h' -o -name '*.cc' | sort)
mode="${1:-all}"

if [ "$mode" = --fix ]; then
  clang-format -i "${sources[@]}"
  exit 0
fi
if [ "$mode" = all ] || [ "$mode" = --format ]; then
  echo "=== clang-format (deploy/lint.sh --fix rewrites the files)"
  clang-format --dry-run --Werror "${sources[@]}"
  [ "$mode" = all ] || exit 0
fi

echo "=== build by clang"
cmake --preset tidy
cmake --build --preset tidy --parallel "$(nproc)"

echo "=== clang-tidy"
if [ "$mode" = all ]; then
  mapfile -t files < <(find client core server tests -name '*.cc' | sort)
else
  files=("$@")
fi
# Only what the preset compiles: fuzz targets and the planted race have builds of their own.
checked=()
for file in "${files[@]}"; do
  if grep -qF "/$file\"" build/tidy/compile_commands.json; then checked+=("$file"); fi
done
echo "${#checked[@]} of ${#files[@]} files"
printf '%s\n' "${checked[@]}" | xargs -P "$(nproc)" -n 1 clang-tidy -p build/tidy --quiet

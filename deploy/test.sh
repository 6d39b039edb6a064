#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
#
# Installs what is missing, builds and runs every test, in three lanes, and two that must be asked for:
#
#   release     the whole tree in Release, sightline-bench among it, all tests
#   core-asan   core and its tests under the address and undefined-behaviour sanitizers
#   fuzz        every libFuzzer target for SIGHTLINE_FUZZ_SECONDS (60), with both sanitizers
#   asan        the whole tree under the address and undefined-behaviour sanitizers: several times as long
#   tsan        the whole tree under the thread sanitizer: likewise
#
#   deploy/test.sh                the three
#   deploy/test.sh core-asan      one of them
#
# Ends with the time per step, the tests that were skipped and why, what failed, and one line
# "N passed, N failed, N skipped". The exit code is 0 only if nothing failed. A test is a TEST() of
# GoogleTest, or a ctest entry of any other kind.
set -uo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

lanes=("$@")
[ ${#lanes[@]} -gt 0 ] || lanes=(release core-asan fuzz)
for lane in "${lanes[@]}"; do
  case "$lane" in
    release | core-asan | fuzz | asan | tsan) ;;
    *)
      echo "usage: $0 [release] [core-asan] [fuzz] [asan] [tsan]" >&2
      exit 2
      ;;
  esac
done
fuzz_seconds="${SIGHTLINE_FUZZ_SECONDS:-60}"
jobs="$(nproc)"

steps=()       # "seconds|result|name", for the table at the end.
failed_steps=0 # Steps that failed without a test to blame.

# step NAME COMMAND...: runs it, keeps its time and result, and returns its exit code.
step() {
  local name="$1" start=$SECONDS code=0
  shift
  printf '\n=== %s\n' "$name"
  "$@" </dev/null || code=$?
  local result=ok
  [ $code -eq 0 ] || result="FAILED ($code)"
  steps+=("$((SECONDS - start))|$result|$name")
  return $code
}

# build_step: as step, for those whose failure is not counted by a test.
build_step() {
  step "$@" || {
    failed_steps=$((failed_steps + 1))
    return 1
  }
}

run_lane() {
  local lane="$1" build="build/$1"
  shift
  rm -rf "$build/test-results" "$build/ctest.xml"
  mkdir -p "$build/test-results"
  build_step "$lane: configure" cmake --preset "$lane" "$@" || return
  build_step "$lane: build" cmake --build --preset "$lane" --parallel "$jobs" || return
  step "$lane: tests" ctest --preset "$lane" --parallel "$jobs" --output-junit "$PWD/$build/ctest.xml" ||
    [ -n "$(list_results "$lane" | awk -F '\t' '$2 == "failed"')" ] ||
    failed_steps=$((failed_steps + 1)) # ctest itself failed, or found no test.
}

# list_results LANE...: one line per test, "lane<TAB>passed|failed|skipped<TAB>name<TAB>reason".
list_results() {
  local lane
  for lane in "$@"; do
    [ -s "build/$lane/ctest.xml" ] || continue
    awk -v lane="$lane" -v folder="build/$lane/test-results" -f deploy/count_tests.awk \
      "build/$lane/ctest.xml"
  done
}

packages=(build test)
for lane in "${lanes[@]}"; do
  if [ "$lane" = release ]; then packages+=(bench); fi # Its peer; the other lanes build no benchmark.
done
build_step "packages" deploy/install_packages.sh "${packages[@]}"
if [ $failed_steps -eq 0 ]; then
  for lane in "${lanes[@]}"; do
    case "$lane" in
      release) run_lane release -DSIGHTLINE_BUILD_BENCH=ON ;;
      fuzz) run_lane fuzz "-DSIGHTLINE_FUZZ_SECONDS=$fuzz_seconds" ;;
      *) run_lane "$lane" ;;
    esac
  done
fi

results="$(list_results "${lanes[@]}")"
count() { printf '%s\n' "$results" | awk -F '\t' -v want="$1" '$2 == want { n++ } END { print n + 0 }'; }
passed=$(count passed)
failed=$(($(count failed) + failed_steps))
skipped=$(count skipped)

printf '\n=== Summary\n'
for entry in "${steps[@]}"; do
  IFS='|' read -r seconds result name <<<"$entry"
  printf '%4d:%02d  %-24s %s\n' $((seconds / 60)) $((seconds % 60)) "$name" "$result"
done
printf '%4d:%02d  %s\n' $((SECONDS / 60)) $((SECONDS % 60)) "in all"

if [ "$skipped" -gt 0 ]; then
  printf '\nSkipped, by reason:\n'
  printf '%s\n' "$results" | awk -F '\t' '
    $2 == "skipped" {
      if (!($4 in n)) order[++reasons] = $4
      n[$4]++
      names[$4] = names[$4] "\n      " $1 ": " $3
    }
    END { for (i = 1; i <= reasons; i++) printf "  %d  %s%s\n", n[order[i]], order[i], names[order[i]] }'
fi
if [ "$failed" -gt 0 ]; then
  printf '\nFailed:\n'
  for entry in "${steps[@]}"; do
    case "$entry" in *"|FAILED"*) printf '  step "%s"\n' "${entry##*|}" ;; esac
  done
  printf '%s\n' "$results" | awk -F '\t' '$2 == "failed" { print "  " $1 ": " $3 " (" $4 ")" }'
fi
printf '\n%d passed, %d failed, %d skipped\n' "$passed" "$failed" "$skipped"
[ "$failed" -eq 0 ] && [ "$passed" -gt 0 ]

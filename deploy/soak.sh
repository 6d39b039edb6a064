#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
#
# An hour of mixed load on a real server: tiles all the time, while scenes come by upload and by name, are stored,
# unloaded, loaded again, reloaded, edited and go, points are kept, all of them are asked about, and clients cancel, are
# refused or vanish half way. Every answer is checked. Ends with a line that says what resident memory did, the medians
# of the second quarter of the rounds, the third and the last, and with 0 only if it grew by less than 5 % and no
# answer was wrong. The suite has the same in short.
#
#   deploy/soak.sh            an hour
#   deploy/soak.sh 600        ten minutes
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

seconds="${1:-3600}"
if [ $# -gt 1 ] || ! [[ "$seconds" =~ ^[0-9]+$ ]]; then
  echo "usage: $0 [SECONDS]" >&2
  exit 2
fi
deploy/install_packages.sh build test
cmake --preset release >/dev/null
cmake --build --preset release --target server_fault_test
SIGHTLINE_SOAK_SECONDS="$seconds" build/release/bin/server_fault_test \
  --gtest_filter=SoakTest.MixedLoadLeavesMemoryWhereItWas

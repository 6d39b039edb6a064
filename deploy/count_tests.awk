# SPDX-License-Identifier: Apache-2.0
#
# Reads ctest's JUnit report and, for each entry that left a GoogleTest report in `folder`, that report in
# its place. Prints "lane<TAB>passed|failed|skipped<TAB>name<TAB>reason" per test. Plain POSIX awk.
#
# An entry that failed although none of its TEST()s did (a crash, a time-out, a leak at exit) counts as one
# failure of its own.

function attribute(line, name,    at) {
  at = index(line, " " name "=\"")
  if (at == 0) return ""
  line = substr(line, at + length(name) + 3)
  return substr(line, 1, index(line, "\"") - 1)
}

function unescape(text) {
  gsub(/&#x0A;|&#10;/, " ", text)
  gsub(/&lt;/, "<", text)
  gsub(/&gt;/, ">", text)
  gsub(/&quot;/, "\"", text)
  gsub(/&apos;/, "'", text)
  gsub(/&amp;/, "\\&", text)
  gsub(/[ \t]+/, " ", text)
  sub(/ $/, "", text)
  return text
}

function emit(result, name, reason) {
  printf "%s\t%s\t%s\t%s\n", lane, result, name, unescape(reason)
}

# One GoogleTest report. Returns whether there is one; sets gtest_failures.
function read_gtest(path,    line, name, result, reason, found) {
  gtest_failures = 0
  found = 0
  name = ""
  while ((getline line < path) > 0) {
    found = 1
    if (line ~ /<testcase /) {
      name = attribute(line, "classname") "." attribute(line, "name")
      reason = ""
      result = "passed"
      if (attribute(line, "result") == "skipped") result = "skipped"
      if (attribute(line, "status") == "notrun") {
        result = "skipped"
        reason = "disabled in the source"
      }
    }
    # "path:line", a line feed, then what the test said.
    if (line ~ /<skipped / && reason == "") {
      reason = attribute(line, "message")
      sub(/^[^&]*&#x0A;/, "", reason)
    }
    if (line ~ /<failure / && result != "failed") {
      result = "failed"
      reason = substr(attribute(line, "message"), 1, 200)
    }
    if (name != "" && (line ~ /<testcase .*\/>/ || line ~ /<\/testcase>/)) {
      if (result == "failed") gtest_failures++
      emit(result, name, reason)
      name = ""
    }
  }
  close(path)
  return found
}

/<testcase / {
  entry = attribute($0, "name")
  status = attribute($0, "status")
  if (read_gtest(folder "/" entry ".xml")) {
    if (status == "fail" && gtest_failures == 0) emit("failed", entry, "its process failed; see the output above")
  } else if (status == "run") {
    emit("passed", entry, "")
  } else if (status == "notrun" || status == "disabled") {
    pending = entry # Skipped, or not built: the next line says which.
  } else {
    emit("failed", entry, "its process failed; see the output above")
  }
}
/<skipped / && pending != "" {
  reason = attribute($0, "message")
  emit(reason ~ /^SKIP_/ ? "skipped" : "failed", pending, reason)
  pending = ""
}
/<\/testcase>/ && pending != "" {
  emit("failed", pending, "not run")
  pending = ""
}

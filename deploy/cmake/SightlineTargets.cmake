# How a target of this project is compiled, in one place.

include_guard(GLOBAL)

set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_POSITION_INDEPENDENT_CODE ON)
set(CMAKE_EXPORT_COMPILE_COMMANDS ON)
set(CMAKE_RUNTIME_OUTPUT_DIRECTORY "${PROJECT_BINARY_DIR}/bin")

if(NOT CMAKE_BUILD_TYPE AND NOT CMAKE_CONFIGURATION_TYPES)
  set(CMAKE_BUILD_TYPE Release CACHE STRING "" FORCE)
endif()
set(CMAKE_CXX_FLAGS_RELEASE "-O3")  # Checks stay on: REQUIRES lines use their own macro.

find_program(CCACHE_PROGRAM ccache)
if(CCACHE_PROGRAM)
  set(CMAKE_CXX_COMPILER_LAUNCHER "${CCACHE_PROGRAM}")
endif()

add_library(sightline_options INTERFACE)
target_include_directories(sightline_options INTERFACE "${PROJECT_SOURCE_DIR}"
                                                       "${PROJECT_BINARY_DIR}")
# -ffp-contract=off: the arithmetic is what is written (design: distances and placements are defined
# by their order of operations). x86-64-v3 is the floor; core/base/cpu_check says so at start.
target_compile_options(sightline_options INTERFACE -march=x86-64-v3 -ffp-contract=off -Wall -Wextra
                                                   -Wno-missing-field-initializers)
# Messages name files from the top of the tree, wherever it was built.
target_compile_options(sightline_options INTERFACE "-fmacro-prefix-map=${PROJECT_SOURCE_DIR}/=")
target_compile_definitions(sightline_options INTERFACE HWY_DISABLE_PCLMUL_AES
                                                       $<$<CONFIG:Debug>:SIGHTLINE_DEBUG_CHECKS>)
# GCC before 12.3 forms fused multiply-adds in its vectorizers in spite of -ffp-contract=off (for pairs like
# x·c - y·s and x·s + y·c). What needs vectors here is written with Highway.
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU" AND CMAKE_CXX_COMPILER_VERSION VERSION_LESS 12.3)
  target_compile_options(sightline_options INTERFACE -fno-tree-vectorize -fno-tree-slp-vectorize)
endif()
# GCC 12 sees overlaps in std::string's operator+ that are none (GCC bug 105651).
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU" AND CMAKE_CXX_COMPILER_VERSION VERSION_LESS 13)
  target_compile_options(sightline_options INTERFACE -Wno-restrict)
endif()
if(SIGHTLINE_WERROR)
  target_compile_options(sightline_options INTERFACE -Werror)
endif()
if(CMAKE_CXX_COMPILER_ID MATCHES "Clang")
  target_compile_options(sightline_options INTERFACE -Werror=thread-safety
                                                     -Wno-deprecated-builtins -Wno-unknown-warning-option)
endif()
if(SIGHTLINE_SANITIZE)
  target_compile_options(sightline_options INTERFACE -fsanitize=${SIGHTLINE_SANITIZE}
                                                     -fno-omit-frame-pointer -g1)
  target_link_options(sightline_options INTERFACE -fsanitize=${SIGHTLINE_SANITIZE})
  target_compile_definitions(sightline_options INTERFACE SIGHTLINE_DEBUG_CHECKS)
  if(SIGHTLINE_SANITIZE MATCHES "undefined")
    target_compile_options(sightline_options INTERFACE -fno-sanitize-recover=undefined)
  endif()
endif()
if(SIGHTLINE_BUILD_FUZZERS)
  if(NOT CMAKE_CXX_COMPILER_ID MATCHES "Clang")
    message(FATAL_ERROR "SIGHTLINE_BUILD_FUZZERS needs clang: use the preset \"fuzz\"")
  endif()
  # Coverage feedback in every library that a fuzz target reaches.
  target_compile_options(sightline_options INTERFACE -fsanitize=fuzzer-no-link)
endif()
# Libraries of Debian are not built for the thread sanitizer; the list names them and says why.
set(SIGHTLINE_TEST_ENVIRONMENT
    "TSAN_OPTIONS=suppressions=${PROJECT_SOURCE_DIR}/deploy/tsan.supp"
    "UBSAN_OPTIONS=print_stacktrace=1")

# Which targets CMAKE_UNITY_BUILD (the suite's presets and what shares a folder with them) compiles several files at a
# time of: server, client, their tests and core's, which then take a fraction of the time: gRPC's or GoogleTest's
# headers are read once for all. Not core and what is mostly its headers (tests/bench, tests/property), much of which is
# compiled once per instruction set, as some of core's tests are; nor what protoc writes. The other presets, clang-tidy's
# among them, compile each file by itself: it has to include what it uses.
function(sightline_choose_unity NAME)
  cmake_path(RELATIVE_PATH CMAKE_CURRENT_SOURCE_DIR BASE_DIRECTORY "${PROJECT_SOURCE_DIR}" OUTPUT_VARIABLE folder)
  if(folder MATCHES "^((tests/)?proto|core|tests/(bench|property))(/|$)")
    set_target_properties(${NAME} PROPERTIES UNITY_BUILD OFF)
  endif()
endfunction()

# sightline_library(NAME SOURCES ... DEPS ...): a static library of one room.
function(sightline_library NAME)
  cmake_parse_arguments(ARG "" "" "SOURCES;DEPS" ${ARGN})
  if(ARG_SOURCES)
    add_library(${NAME} STATIC ${ARG_SOURCES})
    sightline_choose_unity(${NAME})
    target_link_libraries(${NAME} PUBLIC sightline_options ${ARG_DEPS})
  else()
    add_library(${NAME} INTERFACE)
    target_link_libraries(${NAME} INTERFACE sightline_options ${ARG_DEPS})
  endif()
endfunction()

# sightline_test(NAME SOURCES ... DEPS ... [LABELS ...] [TIMEOUT seconds] [ARGS ...] [SERIAL]): one
# GoogleTest binary, one ctest entry. Its TEST()s are listed in its own output and in
# <build>/test-results/NAME.xml, which deploy/test.sh counts. SERIAL keeps other tests from running beside
# it, for those that measure time.
function(sightline_test NAME)
  cmake_parse_arguments(ARG "SERIAL" "TIMEOUT" "SOURCES;DEPS;LABELS;ARGS" ${ARGN})
  add_executable(${NAME} ${ARG_SOURCES})
  sightline_choose_unity(${NAME})
  foreach(source IN LISTS ARG_SOURCES)
    file(STRINGS "${source}" per_instruction_set REGEX "foreach_target" LIMIT_COUNT 1)
    if(per_instruction_set)
      set_source_files_properties("${source}" PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)
    endif()
  endforeach()
  target_link_libraries(${NAME} PRIVATE sightline_options ${ARG_DEPS} GTest::gmock GTest::gtest
                                        GTest::gtest_main)
  # Tests of core compute over its headers and are compiled as it is. The others mostly call what is
  # compiled elsewhere, and take a third less time to compile.
  if(NOT CMAKE_CURRENT_SOURCE_DIR MATCHES "/tests/(bench|core|property)(/|$)")
    target_compile_options(${NAME} PRIVATE "$<$<CONFIG:Release>:-O1>")
  endif()
  if(NOT ARG_TIMEOUT)
    set(ARG_TIMEOUT 300)
  endif()
  if(SIGHTLINE_SANITIZE)
    math(EXPR ARG_TIMEOUT "5 * ${ARG_TIMEOUT}")  # What is not scaled takes about ten times as long.
  endif()
  add_test(NAME ${NAME} COMMAND ${NAME} ${ARG_ARGS})
  set(results "GTEST_OUTPUT=xml:${PROJECT_BINARY_DIR}/test-results/${NAME}.xml")
  # COST: what may take long begins first, so that no core waits for it at the end.
  set_tests_properties(${NAME} PROPERTIES TIMEOUT ${ARG_TIMEOUT} LABELS "${ARG_LABELS}"
                                          RUN_SERIAL ${ARG_SERIAL} COST ${ARG_TIMEOUT}
                                          ENVIRONMENT "${SIGHTLINE_TEST_ENVIRONMENT};${results}")
endfunction()

# sightline_fuzzer(NAME SOURCES ... DEPS ... [CORPUS folder...]): one libFuzzer target (it defines
# LLVMFuzzerTestOneInput) and one ctest entry with the label "fuzz" that runs it for
# SIGHTLINE_FUZZ_SECONDS. Does nothing unless SIGHTLINE_BUILD_FUZZERS is on. The target "fuzzers" builds
# them all. CORPUS folders hold seeds and are only read; what is found goes to the build folder.
set(SIGHTLINE_FUZZ_SECONDS 60 CACHE STRING "How long each fuzz target runs under ctest")
if(SIGHTLINE_BUILD_FUZZERS)
  add_custom_target(fuzzers)
endif()
function(sightline_fuzzer NAME)
  if(NOT SIGHTLINE_BUILD_FUZZERS)
    return()
  endif()
  cmake_parse_arguments(ARG "" "" "SOURCES;DEPS;CORPUS" ${ARGN})
  add_executable(${NAME} ${ARG_SOURCES})
  target_link_libraries(${NAME} PRIVATE sightline_options ${ARG_DEPS})
  target_link_options(${NAME} PRIVATE -fsanitize=fuzzer)
  add_dependencies(fuzzers ${NAME})
  set(found "${PROJECT_BINARY_DIR}/fuzz/${NAME}")
  file(MAKE_DIRECTORY "${found}/corpus")
  list(TRANSFORM ARG_CORPUS PREPEND "${CMAKE_CURRENT_SOURCE_DIR}/" REGEX "^[^/]")
  # An input of more than 10 s or 2 GiB is a finding as much as a crash is.
  add_test(NAME ${NAME}
           COMMAND ${NAME} -max_total_time=${SIGHTLINE_FUZZ_SECONDS} -timeout=10 -rss_limit_mb=2048
                   -print_final_stats=1 -artifact_prefix=${found}/ "${found}/corpus" ${ARG_CORPUS})
  math(EXPR timeout "${SIGHTLINE_FUZZ_SECONDS} + 120")
  set_tests_properties(${NAME} PROPERTIES TIMEOUT ${timeout} LABELS fuzz
                                          ENVIRONMENT "${SIGHTLINE_TEST_ENVIRONMENT}")
endfunction()

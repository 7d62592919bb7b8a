# Functions that make every test program.
find_package(GTest 1.12 REQUIRED)

# Tests and their helpers are compiled with -O1 for a quick build; the tested libraries keep their options.
set(TACTUS_TEST_OPTIONS $<$<CONFIG:Release>:-O1>)
add_executable(tactus_test_precompiled ${PROJECT_BINARY_DIR}/generated/precompiled.cpp)
target_link_libraries(tactus_test_precompiled PRIVATE tactus_options Eigen3::Eigen GTest::gmock GTest::gtest_main)
target_compile_options(tactus_test_precompiled PRIVATE ${TACTUS_TEST_OPTIONS})
target_precompile_headers(tactus_test_precompiled PRIVATE
  <gmock/gmock.h> <gtest/gtest.h> <Eigen/Core> <Eigen/Geometry> <algorithm> <array> <atomic> <chrono> <cmath> <cstdint> <cstring>
  <deque> <filesystem> <fstream> <functional> <map> <memory> <optional> <random> <set> <sstream> <string> <string_view> <thread> <vector>)

# tactus_test(spm LABEL unit SOURCES forest_test.cpp LINK tactus::spm): the GoogleTest program spm_test, and its entry
# in ctest.
#   PROGRAMS tactus-host ...      programs that the test starts; the macro TACTUS_HOST is the path of tactus-host
#   SHARDS n                      n ctest entries, so that a long program uses several processors
#   ALONE 'Suite.*'               filter of test cases with bounds on times or on what a force does in a time; they get
#                                 an entry of their own, which runs while no other test does
#   NIGHTLY 'Suite.*'             filter of long test cases, which get an entry of their own with label nightly
#   TIMEOUT s                     default 120; five times as long in a Debug build, with or without a sanitizer
# scripts/test gives ctest two slots for each processor. A test takes two slots, but one with label dds takes one slot,
# because it mostly waits for other processes.
# The report of each entry goes to reports/ENTRY.xml in the build folder, where scripts/test counts cases.
function(tactus_test name)
  cmake_parse_arguments(ARG "" "LABEL;TIMEOUT;SHARDS;ALONE;NIGHTLY" "SOURCES;LINK;PROGRAMS" ${ARGN})
  set(target ${name}_test)
  add_executable(${target} ${ARG_SOURCES})
  tactus_imports(${target})
  target_link_libraries(${target} PRIVATE tactus_options ${ARG_LINK} GTest::gmock GTest::gtest_main)
  target_compile_options(${target} PRIVATE ${TACTUS_TEST_OPTIONS})
  target_precompile_headers(${target} REUSE_FROM tactus_test_precompiled)
  set_target_properties(${target} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/tests)
  tactus_starts(${target} ${ARG_PROGRAMS})
  if(NOT ARG_TIMEOUT)
    set(ARG_TIMEOUT 120)
  endif()
  if(CMAKE_BUILD_TYPE STREQUAL "Debug")
    math(EXPR ARG_TIMEOUT "${ARG_TIMEOUT} * 5")
  endif()
  if(NOT ARG_SHARDS)
    set(ARG_SHARDS 1)
  endif()
  set(cost 1)
  set(processors 2)
  if(ARG_LABEL STREQUAL "dds")  # the longest tests, so they start first
    set(cost 10)
    set(processors 1)
  endif()
  set(properties TIMEOUT ${ARG_TIMEOUT} COST ${cost} PROCESSORS ${processors})
  string(JOIN ":" elsewhere ${ARG_ALONE} ${ARG_NIGHTLY})
  set(reports "GTEST_OUTPUT=xml:${PROJECT_BINARY_DIR}/reports")
  foreach(shard RANGE 1 ${ARG_SHARDS})
    set(entry ${name})
    if(ARG_SHARDS GREATER 1)
      set(entry ${name}_${shard})
    endif()
    math(EXPR index "${shard} - 1")
    set(environment "${reports}/${entry}.xml;GTEST_TOTAL_SHARDS=${ARG_SHARDS};GTEST_SHARD_INDEX=${index}")
    if(elsewhere)
      list(APPEND environment "GTEST_FILTER=-${elsewhere}")
    endif()
    add_test(NAME ${entry} COMMAND ${target})
    set_tests_properties(${entry} PROPERTIES ${properties} LABELS ${ARG_LABEL} ENVIRONMENT "${environment}")
  endforeach()
  if(ARG_ALONE)
    add_test(NAME ${name}_alone COMMAND ${target})
    set_tests_properties(${name}_alone PROPERTIES ${properties} RUN_SERIAL TRUE LABELS "${ARG_LABEL}"
      ENVIRONMENT "${reports}/${name}_alone.xml;GTEST_FILTER=${ARG_ALONE}")
  endif()
  if(ARG_NIGHTLY)
    add_test(NAME ${name}_nightly COMMAND ${target})
    set_tests_properties(${name}_nightly PROPERTIES ${properties} LABELS "${ARG_LABEL};nightly"
      ENVIRONMENT "${reports}/${name}_nightly.xml;GTEST_FILTER=${ARG_NIGHTLY}")
  endif()
endfunction()

# tactus_starts(TARGET tactus-host ...): TARGET starts these programs. They are built first. Macros contain their paths.
function(tactus_starts target)
  foreach(program IN LISTS ARGN)
    string(REGEX REPLACE "^tactus-" "" macro ${program})
    string(MAKE_C_IDENTIFIER ${macro} macro)
    string(TOUPPER ${macro} macro)
    target_compile_definitions(${target} PRIVATE TACTUS_${macro}="$<TARGET_FILE:${program}>")
    add_dependencies(${target} ${program})
  endforeach()
endfunction()

# tactus_test_support(spm SOURCES mesh_zoo.cpp LINK tactus::spm::offline): library tactus_spm_test_support of test
# helpers.
function(tactus_test_support name)
  cmake_parse_arguments(ARG "" "" "SOURCES;LINK;PROGRAMS" ${ARGN})
  set(target tactus_${name}_test_support)
  add_library(${target} STATIC ${ARG_SOURCES})
  target_link_libraries(${target} PUBLIC tactus_options ${ARG_LINK} PRIVATE GTest::gmock)
  target_compile_options(${target} PRIVATE ${TACTUS_TEST_OPTIONS})
  tactus_starts(${target} ${ARG_PROGRAMS})
endfunction()

# How every target of the project is made: one place for language level, warnings and sanitizers.

set(CMAKE_POSITION_INDEPENDENT_CODE ON)
set(TACTUS_SANITIZE "" CACHE STRING "Sanitizers for every target, e.g. address,undefined or thread")
option(TACTUS_WERROR "Treat warnings as errors" OFF)

add_library(tactus_options INTERFACE)
set_target_properties(tactus_options PROPERTIES EXPORT_NAME options)
target_compile_features(tactus_options INTERFACE cxx_std_17)
# -ffp-contract=off: the same bits from every compiler; geometry is checked bit for bit.
target_compile_options(tactus_options INTERFACE "$<BUILD_INTERFACE:-Wall;-Wextra;-Wpedantic;-Wshadow;-Wconversion;-Wno-sign-conversion>"
                       -ffp-contract=off $<BUILD_INTERFACE:$<$<BOOL:${TACTUS_WERROR}>:-Werror>>)
target_include_directories(tactus_options INTERFACE $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}>)
if(TACTUS_SANITIZE)
  target_compile_options(tactus_options INTERFACE -fsanitize=${TACTUS_SANITIZE} -fno-sanitize-recover=all -fno-omit-frame-pointer)
  target_link_options(tactus_options INTERFACE -fsanitize=${TACTUS_SANITIZE})
endif()

# tactus_module(spm SOURCES a.cpp b.cpp LINK Eigen3::Eigen): library tactus_spm, alias tactus::spm.
function(tactus_module name)
  cmake_parse_arguments(ARG "" "" "SOURCES;LINK;PRIVATE_LINK" ${ARGN})
  string(REPLACE "/" "_" target tactus_${name})
  string(REPLACE "/" "::" alias ${name})
  add_library(${target} STATIC ${ARG_SOURCES})
  add_library(tactus::${alias} ALIAS ${target})
  set_target_properties(${target} PROPERTIES EXPORT_NAME ${alias})
  target_link_libraries(${target} PUBLIC tactus_options ${ARG_LINK} PRIVATE ${ARG_PRIVATE_LINK})
endfunction()

# tactus_program(tactus-host SOURCES main.cpp LINK tactus::host_service): a program that is installed.
function(tactus_program name)
  cmake_parse_arguments(ARG "" "" "SOURCES;LINK" ${ARGN})
  add_executable(${name} ${ARG_SOURCES})
  target_link_libraries(${name} PRIVATE tactus_options ${ARG_LINK})
  set_target_properties(${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/bin)
  install(TARGETS ${name} RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
endfunction()

# tactus_test(spm_forest LABEL unit SOURCES forest_test.cpp LINK tactus::spm): one GoogleTest program, one ctest entry.
function(tactus_test name)
  cmake_parse_arguments(ARG "" "LABEL;TIMEOUT" "SOURCES;LINK" ${ARGN})
  add_executable(${name}_test ${ARG_SOURCES})
  target_link_libraries(${name}_test PRIVATE tactus_options ${ARG_LINK} GTest::gmock GTest::gtest_main)
  set_target_properties(${name}_test PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/tests)
  add_test(NAME ${name} COMMAND ${name}_test)
  if(NOT ARG_TIMEOUT)
    set(ARG_TIMEOUT 120)
  endif()
  if(TACTUS_SANITIZE)  # slower by a factor, and that on machines that do other things
    math(EXPR ARG_TIMEOUT "${ARG_TIMEOUT} * 5")
  endif()
  set_tests_properties(${name} PROPERTIES LABELS ${ARG_LABEL} TIMEOUT ${ARG_TIMEOUT})
endfunction()

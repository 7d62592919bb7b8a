# Functions that make every target of the project, with language level, warnings and sanitizers in one place.

set(CMAKE_POSITION_INDEPENDENT_CODE ON)
set(TACTUS_SANITIZE "" CACHE STRING "Sanitizers for every target, e.g. address,undefined or thread")
option(TACTUS_COVERAGE "Count how often each line is executed" OFF)
option(TACTUS_FUZZ "Build the fuzz targets of tests/fuzz for libFuzzer; needs clang" OFF)
option(TACTUS_WERROR "Treat warnings as errors" OFF)

add_library(tactus_options INTERFACE)
set_target_properties(tactus_options PROPERTIES EXPORT_NAME options)
target_compile_features(tactus_options INTERFACE cxx_std_20)
# -Wno-subobject-linkage: in a joined source, g++ takes the unnamed namespace of each source for one of a header.
# -Wno-error=maybe-uninitialized: g++ 14 takes members of std::optional for uninitialized, depending on what they
# inline.
# -ffp-contract=off: tests compare geometry bit for bit, so every compiler must give the same bits.
target_compile_options(tactus_options INTERFACE "$<BUILD_INTERFACE:-Wall;-Wextra;-Wpedantic;-Wshadow;-Wconversion;-Wno-sign-conversion;-Wno-psabi>"
                       $<BUILD_INTERFACE:$<$<AND:$<BOOL:${CMAKE_UNITY_BUILD}>,$<COMPILE_LANGUAGE:CXX>,$<CXX_COMPILER_ID:GNU>>:-Wno-subobject-linkage>>
                       -ffp-contract=off $<BUILD_INTERFACE:$<$<BOOL:${TACTUS_WERROR}>:-Werror>>
                       $<BUILD_INTERFACE:$<$<AND:$<CXX_COMPILER_ID:GNU>,$<VERSION_GREATER_EQUAL:$<CXX_COMPILER_VERSION>,14>>:-Wno-error=maybe-uninitialized>>)
target_include_directories(tactus_options INTERFACE $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}>)
# Debian 13's TinyXML-2 defines it for its users, and a precompiled header is only used with the same definitions.
target_compile_definitions(tactus_options INTERFACE $<BUILD_INTERFACE:_FILE_OFFSET_BITS=64>)
if(TACTUS_SANITIZE)
  # With sanitizers, g++ 12 takes members of std::regex and others for uninitialized.
  target_compile_options(tactus_options INTERFACE -fsanitize=${TACTUS_SANITIZE} -fno-sanitize-recover=all -fno-omit-frame-pointer
                         $<$<CXX_COMPILER_ID:GNU>:-Wno-maybe-uninitialized>)
  if(TACTUS_SANITIZE STREQUAL thread)  # Boost.Asio has fences, which ThreadSanitizer does not see
    target_compile_options(tactus_options INTERFACE -Wno-tsan)
  endif()
  target_link_options(tactus_options INTERFACE -fsanitize=${TACTUS_SANITIZE})
endif()
if(TACTUS_COVERAGE)
  target_compile_options(tactus_options INTERFACE --coverage -fprofile-update=atomic)
  target_link_options(tactus_options INTERFACE --coverage)
endif()

# Precompiled headers of other libraries that most sources include: for our libraries here, for tests in
# cmake/TactusTests.cmake. Headers of the project are not precompiled, so that each source has to include what it uses.
find_package(Eigen3 3.4 REQUIRED NO_MODULE)
file(CONFIGURE OUTPUT ${CMAKE_CURRENT_BINARY_DIR}/generated/precompiled.cpp CONTENT "\n")
add_library(tactus_precompiled STATIC ${CMAKE_CURRENT_BINARY_DIR}/generated/precompiled.cpp)
target_link_libraries(tactus_precompiled PRIVATE tactus_options Eigen3::Eigen)
target_precompile_headers(tactus_precompiled PRIVATE
  <Eigen/Core> <Eigen/Geometry> <algorithm> <array> <atomic> <bit> <cmath> <cstdint> <functional> <map> <memory> <mutex> <optional>
  <span> <string> <string_view> <unordered_map> <utility> <vector>)

# tactus_module(spm SOURCES a.cpp b.cpp LINK Eigen3::Eigen): library tactus_spm, alias tactus::spm.
function(tactus_module name)
  cmake_parse_arguments(ARG "" "" "SOURCES;LINK;PRIVATE_LINK" ${ARGN})
  string(REPLACE "/" "_" target tactus_${name})
  string(REPLACE "/" "::" alias ${name})
  add_library(${target} STATIC ${ARG_SOURCES})
  add_library(tactus::${alias} ALIAS ${target})
  set_target_properties(${target} PROPERTIES EXPORT_NAME ${alias})
  target_link_libraries(${target} PUBLIC tactus_options ${ARG_LINK} PRIVATE ${ARG_PRIVATE_LINK})
  target_precompile_headers(${target} REUSE_FROM tactus_precompiled)
endfunction()

# tactus_imports(TARGET): TARGET may import a foreign model, for which it starts tactus-import. So a build of TARGET alone
# also builds tactus-import.
function(tactus_imports target)
  if(TARGET tactus-import AND NOT target STREQUAL "tactus-import")
    add_dependencies(${target} tactus-import)
  endif()
endfunction()

# tactus_program(tactus-host SOURCES main.cpp LINK tactus::host_service [FOLDER bin] [COMPONENT spm]): a program that is
# installed in FOLDER. A main.cpp only parses options, so it is compiled with -O1 for a quick build.
function(tactus_program name)
  cmake_parse_arguments(ARG "" "FOLDER;COMPONENT" "SOURCES;LINK" ${ARGN})
  if(NOT ARG_FOLDER)
    set(ARG_FOLDER ${CMAKE_INSTALL_BINDIR})
  endif()
  if(NOT ARG_COMPONENT)
    set(ARG_COMPONENT Unspecified)
  endif()
  set_source_files_properties(main.cpp PROPERTIES COMPILE_OPTIONS -O1)
  add_executable(${name} ${ARG_SOURCES})
  tactus_imports(${name})
  target_link_libraries(${name} PRIVATE tactus_options ${ARG_LINK})
  set_target_properties(${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/bin)
  install(TARGETS ${name} RUNTIME DESTINATION ${ARG_FOLDER} COMPONENT ${ARG_COMPONENT})
endfunction()

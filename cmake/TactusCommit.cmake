# tactus_commit_header: the header tactus/commit.hpp with the commit of the sources at build time. Benchmarks print the
# commit with their figures, and tactus --version prints it.
add_custom_target(tactus_commit
  COMMAND ${CMAKE_COMMAND} -DSOURCE=${PROJECT_SOURCE_DIR} -DOUT=${PROJECT_BINARY_DIR}/generated/tactus/commit.hpp
          -P ${CMAKE_CURRENT_LIST_DIR}/commit.cmake
  BYPRODUCTS ${PROJECT_BINARY_DIR}/generated/tactus/commit.hpp VERBATIM)
add_library(tactus_commit_header INTERFACE)
add_dependencies(tactus_commit_header tactus_commit)
target_include_directories(tactus_commit_header INTERFACE ${PROJECT_BINARY_DIR}/generated)

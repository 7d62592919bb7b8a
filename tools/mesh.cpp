#include <unistd.h>

#include <iostream>

#include "tools/mesh_tool.hpp"

int main(int argc, char** argv) {
  return tactus::tools::run_mesh_tool(argc, argv, {std::cout, std::cerr, ::isatty(STDERR_FILENO) != 0});
}

# Writes build_id.cpp to OUT: a digest of the COMPILER, its OPTIONS, and the files below SOURCE of all modules that
# compute forces. Takes whole modules, so that no new file is forgotten. Leaves an unchanged file untouched.
cmake_policy(VERSION 3.25)
include(${CMAKE_CURRENT_LIST_DIR}/force_modules.cmake)
set(patterns ${SOURCE}/cmake/TactusTargets.cmake)  # has compiler options
foreach(module IN LISTS force_modules replay_modules ITEMS hrtc_service/servo)
  list(APPEND patterns ${SOURCE}/${module}/*)
endforeach()
file(GLOB sources RELATIVE ${SOURCE} LIST_DIRECTORIES false ${patterns})
list(SORT sources)
set(all "${COMPILER} ${OPTIONS}")
foreach(source IN LISTS sources)
  file(SHA256 ${SOURCE}/${source} digest)
  string(APPEND all " ${source} ${digest}")
endforeach()
string(SHA256 digest "${all}")
string(SUBSTRING ${digest} 0 16 digest)
file(CONFIGURE OUTPUT ${OUT} @ONLY CONTENT
  "#include \"hrtc_service/servo/build_id.hpp\"\n\nnamespace tactus::hrtc_service {\n\nconst char* build_id() noexcept { return \"@digest@ (@COMPILER@)\"; }\n\n}  // namespace tactus::hrtc_service\n")

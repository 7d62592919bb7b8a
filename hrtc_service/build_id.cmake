# Writes build_id.cpp to OUT: a digest of the COMPILER, its OPTIONS, and the sources below SOURCE that compute forces.
# Leaves an unchanged file untouched.
cmake_policy(VERSION 3.25)
file(GLOB sources RELATIVE ${SOURCE} LIST_DIRECTORIES false
     ${SOURCE}/spm/*.[chi]* ${SOURCE}/spm/codec/*.[ch]pp ${SOURCE}/haptics/*.[ch]* ${SOURCE}/session/messages.hpp
     ${SOURCE}/hrtc_service/cycle.* ${SOURCE}/hrtc_service/touch_object.* ${SOURCE}/trace/flight_file.hpp)
list(SORT sources)
set(all "${COMPILER} ${OPTIONS}")
foreach(source IN LISTS sources)
  file(SHA256 ${SOURCE}/${source} digest)
  string(APPEND all " ${source} ${digest}")
endforeach()
string(SHA256 digest "${all}")
string(SUBSTRING ${digest} 0 16 digest)
file(CONFIGURE OUTPUT ${OUT} @ONLY CONTENT
  "#include \"hrtc_service/build_id.hpp\"\n\nnamespace tactus::hrtc_service {\n\nconst char* build_id() noexcept { return \"@digest@ (@COMPILER@)\"; }\n\n}  // namespace tactus::hrtc_service\n")

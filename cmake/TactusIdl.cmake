# tactus_idl(tactus_idl idl/tactus.idl): static library of the types that fastddsgen generates from an IDL file at build
# time. Generated sources go to the build tree. Include "<name of the IDL file>.h". They are compiled without warnings.
find_package(fastcdr 1.0 REQUIRED)
find_package(fastrtps 2.9 REQUIRED)
find_program(FASTDDSGEN fastddsgen)
find_program(TACTUS_JAVA java HINTS ENV JAVA_HOME PATH_SUFFIXES bin)
if(NOT FASTDDSGEN OR NOT TACTUS_JAVA)
  message(FATAL_ERROR "Generating the topic types needs fastddsgen (found: ${FASTDDSGEN}) and a Java runtime "
                      "(found: ${TACTUS_JAVA}). On Debian 12: apt-get install fastddsgen default-jre-headless")
endif()

function(tactus_idl target idl)
  get_filename_component(idl ${idl} ABSOLUTE BASE_DIR ${PROJECT_SOURCE_DIR})
  get_filename_component(stem ${idl} NAME_WE)
  set(dir ${PROJECT_BINARY_DIR}/${target})
  set(generated ${dir}/${stem}.cxx ${dir}/${stem}PubSubTypes.cxx)
  set(headers ${dir}/${stem}.h ${dir}/${stem}PubSubTypes.h)
  file(MAKE_DIRECTORY ${dir})
  add_custom_command(
    OUTPUT ${generated} ${headers}
    COMMAND ${FASTDDSGEN} -replace -t ${dir} -d ${dir} ${idl} > ${dir}/fastddsgen.log
    DEPENDS ${idl} WORKING_DIRECTORY ${dir} COMMENT "Generating the types of ${stem}.idl" VERBATIM)
  add_library(${target} STATIC ${generated} ${headers})
  target_compile_features(${target} PUBLIC cxx_std_20)
  target_compile_options(${target} PRIVATE -w)
  target_include_directories(${target} SYSTEM PUBLIC $<BUILD_INTERFACE:${dir}>)
  set_target_properties(${target} PROPERTIES EXPORT_NAME idl)
  target_link_libraries(${target} PUBLIC fastrtps fastcdr)
  if(TACTUS_SANITIZE)
    target_compile_options(${target} PRIVATE -fsanitize=${TACTUS_SANITIZE})
  endif()
endfunction()

# Files that `cmake --install` installs for a program outside this tree: the package of find_package(tactus) with
# libraries and headers, qos/ and idl/. tactus_program() installs the programs.
#
#   component spm     models and local refinement, offline build included; needs neither DDS nor FCL:
#                     find_package(tactus COMPONENTS spm), `cmake --install DIR --component spm`
#   no component      libraries to join a session, and the interface of a device
include(CMakePackageConfigHelpers)

set(package ${CMAKE_INSTALL_LIBDIR}/cmake/tactus)
set(headers ${CMAKE_INSTALL_INCLUDEDIR}/tactus)
target_include_directories(tactus_options INTERFACE $<INSTALL_INTERFACE:${headers}>)
configure_package_config_file(cmake/tactusConfig.cmake.in ${PROJECT_BINARY_DIR}/tactusConfig.cmake INSTALL_DESTINATION ${package})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/tactusConfigVersion.cmake COMPATIBILITY SameMinorVersion)

install(DIRECTORY spm/ DESTINATION ${headers}/spm COMPONENT spm FILES_MATCHING PATTERN *.hpp PATTERN fcl EXCLUDE)
install(TARGETS tactus_options tactus_spm tactus_spm_codec tactus_spm_offline EXPORT tactus_spm
        ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT spm)
install(EXPORT tactus_spm NAMESPACE tactus:: DESTINATION ${package} FILE tactusSpmTargets.cmake COMPONENT spm)
install(FILES ${PROJECT_BINARY_DIR}/tactusConfig.cmake ${PROJECT_BINARY_DIR}/tactusConfigVersion.cmake
        DESTINATION ${package} COMPONENT spm)
if(NOT TARGET tactus_wire OR NOT TARGET tactus_haptics)
  return()
endif()

# The public headers of the other libraries. Each includes only installed headers; tests/outside tests this.
set(interface
  haptics/device.hpp haptics/device_plugin.h haptics/mailbox.hpp haptics/simulated_device.hpp
  realtime/process.hpp realtime/realtime.hpp
  session/clock.hpp session/figures.hpp session/messages.hpp session/roster.hpp session/sequence_window.hpp session/severity.hpp
  wire/address/address.hpp wire/endpoints.hpp wire/error.hpp wire/participants.hpp wire/topics.hpp)
foreach(header IN LISTS interface)
  get_filename_component(folder ${header} DIRECTORY)
  install(FILES ${header} DESTINATION ${headers}/${folder})
endforeach()

target_compile_definitions(tactus_wire INTERFACE $<INSTALL_INTERFACE:TACTUS_QOS_DIR="$<INSTALL_PREFIX>/${CMAKE_INSTALL_DATADIR}/tactus/qos">)
install(TARGETS tactus_idl tactus_haptics tactus_keys tactus_realtime tactus_session tactus_yaml tactus_wire_address tactus_wire EXPORT tactus ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
install(EXPORT tactus NAMESPACE tactus:: DESTINATION ${package} FILE tactusTargets.cmake)
install(DIRECTORY qos/ DESTINATION ${CMAKE_INSTALL_DATADIR}/tactus/qos)
install(FILES idl/tactus.idl idl/flight.idl idl/foxglove.idl idl/ros2.idl DESTINATION ${CMAKE_INSTALL_DATADIR}/tactus/idl)
install(FILES tools/record/foxglove-layout.json DESTINATION ${CMAKE_INSTALL_DATADIR}/tactus)

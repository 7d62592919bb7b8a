# What `cmake --install` gives a program outside this tree: find_package(tactus), with the libraries that join a session and
# are a device there, their headers, qos/ and idl/. The programs are installed where tactus_program() makes them.
include(CMakePackageConfigHelpers)

set(package ${CMAKE_INSTALL_LIBDIR}/cmake/tactus)
set(headers ${CMAKE_INSTALL_INCLUDEDIR}/tactus)

# The headers of these libraries that are meant for others; each includes only what is listed too, which tests/outside holds.
set(interface
  haptics/device.hpp haptics/device_plugin.h haptics/mailbox.hpp haptics/simulated_device.hpp
  session/clock.hpp session/figures.hpp session/messages.hpp session/roster.hpp session/sequence_window.hpp
  spm/ids.hpp spm/model.hpp spm/record.hpp spm/span.hpp spm/surface_points.hpp
  wire/endpoints.hpp wire/error.hpp wire/participants.hpp wire/process.hpp wire/realtime.hpp wire/topics.hpp)
foreach(header IN LISTS interface)
  get_filename_component(folder ${header} DIRECTORY)
  install(FILES ${header} DESTINATION ${headers}/${folder})
endforeach()

target_include_directories(tactus_options INTERFACE $<INSTALL_INTERFACE:${headers}>)
target_compile_definitions(tactus_wire INTERFACE $<INSTALL_INTERFACE:TACTUS_QOS_DIR="$<INSTALL_PREFIX>/${CMAKE_INSTALL_DATADIR}/tactus/qos">)
install(TARGETS tactus_options tactus_idl tactus_spm tactus_spm_codec tactus_haptics tactus_session tactus_wire
        EXPORT tactus ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
install(EXPORT tactus NAMESPACE tactus:: DESTINATION ${package} FILE tactusTargets.cmake)

configure_package_config_file(cmake/tactusConfig.cmake.in ${PROJECT_BINARY_DIR}/tactusConfig.cmake INSTALL_DESTINATION ${package})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/tactusConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/tactusConfig.cmake ${PROJECT_BINARY_DIR}/tactusConfigVersion.cmake DESTINATION ${package})
install(DIRECTORY qos/ DESTINATION ${CMAKE_INSTALL_DATADIR}/tactus/qos)
install(FILES idl/tactus.idl idl/flight.idl DESTINATION ${CMAKE_INSTALL_DATADIR}/tactus/idl)

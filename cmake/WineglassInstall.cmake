# cmake --install: the rooms as wineglass::core, ::application, ::host, ::sim for find_package(wineglass).

include(CMakePackageConfigHelpers)
get_property(rooms GLOBAL PROPERTY WINEGLASS_ROOMS)
set(package_dir ${CMAKE_INSTALL_LIBDIR}/cmake/wineglass)

set(installed_targets)
foreach(room IN LISTS rooms)
  list(APPEND installed_targets wineglass_${room})
endforeach()
if(NOT installed_targets)
  return()
endif()

install(TARGETS ${installed_targets} EXPORT wineglass_targets ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
if(TARGET wineglass_twin)
  install(TARGETS wineglass_twin LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR})
endif()
install(EXPORT wineglass_targets NAMESPACE wineglass:: FILE wineglass-targets.cmake DESTINATION ${package_dir})

file(WRITE ${PROJECT_BINARY_DIR}/wineglass-config.cmake
  "include(\${CMAKE_CURRENT_LIST_DIR}/wineglass-targets.cmake)\n")
write_basic_package_version_file(${PROJECT_BINARY_DIR}/wineglass-config-version.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/wineglass-config.cmake ${PROJECT_BINARY_DIR}/wineglass-config-version.cmake
        DESTINATION ${package_dir})
install(FILES ${PROJECT_SOURCE_DIR}/LICENSE DESTINATION ${CMAKE_INSTALL_DATADIR}/licenses/wineglass)

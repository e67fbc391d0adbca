# Every tests/unit/ROOM/test_NAME.c and tests/system/test_NAME.c is one Unity executable and one ctest test
# (unit.ROOM.NAME, system.NAME). Shared helpers: tests/support/*.c, found as "support/x.h".

include(WineglassUnity)

add_library(wineglass_test_settings INTERFACE)
target_link_libraries(wineglass_test_settings INTERFACE wineglass_unity wineglass_warnings wineglass_sanitizers m)
target_include_directories(wineglass_test_settings INTERFACE ${PROJECT_SOURCE_DIR}/tests)
target_compile_definitions(wineglass_test_settings INTERFACE
  _DEFAULT_SOURCE WINEGLASS_SOURCE_DIR="${PROJECT_SOURCE_DIR}")
# References are computed in double precision: the same bits with every compiler.
target_compile_options(wineglass_test_settings INTERFACE -ffp-contract=off)

get_property(wineglass_rooms GLOBAL PROPERTY WINEGLASS_ROOMS)

# Links those of the named rooms that exist.
function(wineglass_link_rooms target)
  foreach(room IN LISTS ARGN)
    if(room IN_LIST wineglass_rooms)
      target_link_libraries(${target} PRIVATE wineglass_${room})
    endif()
  endforeach()
endfunction()

function(wineglass_unit_tests label folder)
  file(GLOB sources CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/${folder}/test_*.c)
  foreach(source IN LISTS sources)
    cmake_path(GET source STEM name)
    string(REPLACE "." "_" target ${label}_${name})
    add_executable(${target} ${source})
    target_link_libraries(${target} PRIVATE wineglass_test_settings)
    if(TARGET wineglass_test_support)
      target_link_libraries(${target} PRIVATE wineglass_test_support)
    endif()
    wineglass_link_rooms(${target} ${ARGN})
    string(REGEX REPLACE "^test_" "" name ${name})
    add_test(NAME ${label}.${name} COMMAND ${target} WORKING_DIRECTORY ${PROJECT_BINARY_DIR})
    set_tests_properties(${label}.${name} PROPERTIES LABELS ${label} TIMEOUT 300)
  endforeach()
endfunction()

file(GLOB support_sources CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/tests/support/*.c)
if(support_sources)
  add_library(wineglass_test_support STATIC ${support_sources})
  target_link_libraries(wineglass_test_support PUBLIC wineglass_test_settings)
  wineglass_link_rooms(wineglass_test_support sim host application core)
endif()

wineglass_unit_tests(unit.core tests/unit/core core)
wineglass_unit_tests(unit.application tests/unit/application sim host application core)
wineglass_unit_tests(unit.host tests/unit/host sim host application core)
wineglass_unit_tests(unit.sim tests/unit/sim sim host application core)
wineglass_unit_tests(system tests/system sim host application core)

# The firmware must compile freestanding and without a single floating-point register.
if(CMAKE_C_COMPILER_ID STREQUAL "GNU" AND CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64|aarch64")
  foreach(check firmware refuses_float)
    add_test(NAME structure.no_floating_point.${check}
      COMMAND ${CMAKE_COMMAND} -DCOMPILER=${CMAKE_C_COMPILER} -DROOT=${PROJECT_SOURCE_DIR} -DCHECK=${check}
              -DWORK=${PROJECT_BINARY_DIR}/no_floating_point -P ${PROJECT_SOURCE_DIR}/cmake/check_no_floating_point.cmake)
    set_tests_properties(structure.no_floating_point.${check} PROPERTIES LABELS structure)
  endforeach()
endif()

# Install into an empty prefix, then build and run a stranger's project against it.
if(TARGET wineglass_core AND NOT WINEGLASS_SANITIZE AND EXISTS ${PROJECT_SOURCE_DIR}/tests/install/CMakeLists.txt)
  add_test(NAME structure.install_and_find_package
    COMMAND ${CMAKE_COMMAND} -DBUILD=${PROJECT_BINARY_DIR} -DCONSUMER=${PROJECT_SOURCE_DIR}/tests/install
            -DCOMPILER=${CMAKE_C_COMPILER} -DGENERATOR=${CMAKE_GENERATOR} -DVERSION=${PROJECT_VERSION}
            -P ${PROJECT_SOURCE_DIR}/cmake/check_install.cmake)
  set_tests_properties(structure.install_and_find_package PROPERTIES LABELS structure TIMEOUT 120)
endif()

# wineglass_library(ROOM SOURCES globs... [HEADERS dirs...] [INCLUDE dirs...] [LINK rooms...] [OPTIONS ...] [DEFINITIONS ...])
#
# Static library wineglass_ROOM (alias wineglass::ROOM) of every file that the globs find. A room without sources yet
# makes no target. HEADERS are folders below the room whose *.h are installed.

set(CMAKE_C_STANDARD 11)
set(CMAKE_C_STANDARD_REQUIRED ON)
set(CMAKE_C_EXTENSIONS OFF)
set(CMAKE_C_VISIBILITY_PRESET hidden)
if(NOT WINEGLASS_BOARD) # a microcontroller's image stands at a fixed address
  set(CMAKE_POSITION_INDEPENDENT_CODE ON)
endif()
set(CMAKE_EXPORT_COMPILE_COMMANDS ON)
set(CMAKE_ARCHIVE_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/lib)
set(CMAKE_LIBRARY_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/lib)
set(CMAKE_RUNTIME_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/bin)

# Assertions stay on in the host build; CMake's default would define NDEBUG there.
set(CMAKE_C_FLAGS_RELWITHDEBINFO "-O2 -g")

# Link-time objects that also hold machine code: an installed archive must link without link-time optimisation.
if(CMAKE_INTERPROCEDURAL_OPTIMIZATION AND CMAKE_C_COMPILER_ID STREQUAL "GNU")
  set(CMAKE_C_COMPILE_OPTIONS_IPO -flto=auto -ffat-lto-objects)
endif()

add_library(wineglass_warnings INTERFACE)
target_compile_options(wineglass_warnings INTERFACE
  -Wall -Wextra -Wconversion -Wsign-conversion -Wshadow -Wstrict-prototypes
  # enum { N = 100 } is how C11 names an integer constant; dividing by it is no mistake.
  $<$<C_COMPILER_ID:Clang>:-Wno-enum-float-conversion>
  # Errors even where warnings are not (the release library, built by compilers that nobody here has tried).
  -Werror=implicit-function-declaration -Werror=incompatible-pointer-types -Werror=int-conversion
  $<$<BOOL:${WINEGLASS_WERROR}>:-Werror>)

add_library(wineglass_sanitizers INTERFACE)
if(WINEGLASS_SANITIZE)
  set(sanitizer_flags -fsanitize=address,undefined -fno-sanitize-recover=all -fno-omit-frame-pointer)
  target_compile_options(wineglass_sanitizers INTERFACE ${sanitizer_flags})
  target_link_options(wineglass_sanitizers INTERFACE ${sanitizer_flags})
endif()
if(WINEGLASS_FUZZ) # coverage feedback; the fuzzer itself is linked into the harnesses only
  target_compile_options(wineglass_sanitizers INTERFACE -fsanitize=fuzzer-no-link)
endif()

function(wineglass_library room)
  cmake_parse_arguments(PARSE_ARGV 1 arg "" "" "SOURCES;HEADERS;INCLUDE;LINK;OPTIONS;DEFINITIONS")
  file(GLOB sources CONFIGURE_DEPENDS ${arg_SOURCES})
  if(NOT sources)
    message(STATUS "wineglass: no sources in room ${room} yet")
    return()
  endif()

  set(target wineglass_${room})
  add_library(${target} STATIC ${sources})
  add_library(wineglass::${room} ALIAS ${target})
  set_target_properties(${target} PROPERTIES EXPORT_NAME ${room})
  target_compile_features(${target} PUBLIC c_std_11)
  target_compile_options(${target} PRIVATE -Wmissing-prototypes ${arg_OPTIONS})
  target_compile_definitions(${target} PRIVATE ${arg_DEFINITIONS})
  target_link_libraries(${target} PRIVATE $<BUILD_INTERFACE:wineglass_warnings>
                                          $<BUILD_INTERFACE:wineglass_sanitizers>)
  foreach(directory IN LISTS arg_INCLUDE)
    target_include_directories(${target} PUBLIC $<BUILD_INTERFACE:${directory}>)
  endforeach()
  target_include_directories(${target} PUBLIC $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}/wineglass>)
  foreach(needed IN LISTS arg_LINK)
    if(TARGET wineglass_${needed})
      target_link_libraries(${target} PUBLIC wineglass_${needed})
    endif()
  endforeach()

  set_property(GLOBAL APPEND PROPERTY WINEGLASS_ROOMS ${room})
  wineglass_install_headers(${arg_HEADERS})
endfunction()

# Headers keep the paths by which the code includes them: core/gyro.h, application/application.h, hal/hal.h, sim/twin.h.
function(wineglass_install_headers)
  cmake_path(RELATIVE_PATH CMAKE_CURRENT_SOURCE_DIR BASE_DIRECTORY ${PROJECT_SOURCE_DIR} OUTPUT_VARIABLE room_path)
  string(REGEX REPLACE "^firmware/?" "" room_path "${room_path}")
  foreach(directory IN LISTS ARGN)
    file(GLOB headers CONFIGURE_DEPENDS ${directory}/*.h)
    cmake_path(SET destination NORMALIZE ${CMAKE_INSTALL_INCLUDEDIR}/wineglass/${room_path}/${directory})
    install(FILES ${headers} DESTINATION ${destination})
  endforeach()
endfunction()

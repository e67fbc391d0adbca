# Target `unity`, the C unit test framework (MIT). Never part of this tree. Looked for in this order:
#   1. UNITY_DIR (CMake variable or environment): a folder with unity.c, flat or in Unity's own layout
#   2. find_package(unity)
#   3. an earlier fetch, in build/unity
#   4. a fetch by pip: Unity 2.6.0 inside the source archive of cantools, pinned by its hash
#   5. the system package `cmock`, which carries Unity

set(unity_requirement
  "cantools==45.1.0 --hash=sha256:ea1619f3d6108a1c3ecd0f81c952ff2dffd023b244704f6f7a17c4f4dca75f73")
set(unity_cache ${PROJECT_SOURCE_DIR}/build/unity)

# Names the folder below `root` that holds unity.c, or nothing.
function(unity_source_folder root result)
  set(${result} "" PARENT_SCOPE)
  foreach(folder ${root} ${root}/src)
    if(EXISTS ${folder}/unity.c)
      set(${result} ${folder} PARENT_SCOPE)
      return()
    endif()
  endforeach()
endfunction()

# The project's own environment first: its build tools are pinned too.
function(unity_find_pip result)
  set(environment_python ${PROJECT_SOURCE_DIR}/.venv/bin/python)
  if(EXISTS ${environment_python})
    # Looked for, not imported: pip and setuptools do not always like each other in one process.
    execute_process(COMMAND ${environment_python} -c
                    "import importlib.util as u, sys; sys.exit(not all(map(u.find_spec, ('pip', 'setuptools', 'setuptools_scm'))))"
                    RESULT_VARIABLE status OUTPUT_QUIET ERROR_QUIET)
    if(status EQUAL 0)
      set(${result} ${environment_python} -m pip download --no-build-isolation PARENT_SCOPE)
      return()
    endif()
  endif()
  find_program(WINEGLASS_SYSTEM_PYTHON NAMES python3)
  mark_as_advanced(WINEGLASS_SYSTEM_PYTHON)
  set(${result} ${WINEGLASS_SYSTEM_PYTHON} -m pip download PARENT_SCOPE)
endfunction()

function(unity_fetch)
  file(LOCK ${unity_cache}.lock GUARD FUNCTION TIMEOUT 300)
  if(EXISTS ${unity_cache}/unity.c)
    return()
  endif()
  message(STATUS "wineglass: fetching Unity (pinned by hash) into ${unity_cache}")
  unity_find_pip(pip_download)
  set(work ${unity_cache}.work)
  file(REMOVE_RECURSE ${work})
  file(WRITE ${work}/requirements.txt "${unity_requirement}\n")
  execute_process(
    COMMAND ${pip_download} --quiet --disable-pip-version-check --no-deps --no-binary cantools --require-hashes
            -r ${work}/requirements.txt -d ${work}
    RESULT_VARIABLE status ERROR_VARIABLE message OUTPUT_QUIET)
  file(GLOB archive ${work}/cantools-*.tar.gz)
  if(NOT status EQUAL 0 OR NOT archive)
    message(STATUS "wineglass: pip could not fetch Unity: ${message}")
    return()
  endif()
  file(ARCHIVE_EXTRACT INPUT ${archive} DESTINATION ${work} PATTERNS "*/test_framework/*")
  file(GLOB framework ${work}/cantools-*/tests/test_c_code/test_framework)
  file(REMOVE_RECURSE ${unity_cache})
  file(RENAME ${framework} ${unity_cache})
  file(REMOVE_RECURSE ${work})
endfunction()

function(unity_locate result)
  foreach(root "${UNITY_DIR}" "$ENV{UNITY_DIR}")
    if(root)
      unity_source_folder(${root} folder)
      if(NOT folder)
        message(FATAL_ERROR "UNITY_DIR=${root} holds no unity.c: give the folder of the Unity test framework")
      endif()
      set(${result} ${folder} PARENT_SCOPE)
      return()
    endif()
  endforeach()
  unity_fetch()
  foreach(root ${unity_cache} /usr/share/cmock/vendor/unity)
    unity_source_folder(${root} folder)
    if(folder)
      set(${result} ${folder} PARENT_SCOPE)
      return()
    endif()
  endforeach()
  message(FATAL_ERROR "Unity was not found and could not be fetched. Either give -DUNITY_DIR=<folder with unity.c>, "
                      "install the system package cmock, or build without tests: -DWINEGLASS_TESTS=OFF")
endfunction()

function(unity_provide)
  if(NOT UNITY_DIR AND NOT DEFINED ENV{UNITY_DIR})
    find_package(unity QUIET GLOBAL)
    foreach(target unity::framework unity::unity)
      if(TARGET ${target})
        add_library(wineglass_unity INTERFACE)
        target_link_libraries(wineglass_unity INTERFACE ${target})
        return()
      endif()
    endforeach()
  endif()
  unity_locate(folder)
  add_library(wineglass_unity STATIC ${folder}/unity.c)
  target_include_directories(wineglass_unity SYSTEM PUBLIC ${folder})
  target_compile_definitions(wineglass_unity PUBLIC UNITY_INCLUDE_DOUBLE UNITY_SUPPORT_64)
  target_link_libraries(wineglass_unity PRIVATE wineglass_sanitizers)
endfunction()

unity_provide()

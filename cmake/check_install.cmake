# Installs the build into a new prefix and builds the project in tests/install against it.

set(prefix ${BUILD}/install_check/prefix)
set(consumer_build ${BUILD}/install_check/build)
file(REMOVE_RECURSE ${prefix} ${consumer_build})

foreach(step
    "--install;${BUILD};--prefix;${prefix}"
    "-S;${CONSUMER};-B;${consumer_build};-G;${GENERATOR};-DCMAKE_PREFIX_PATH=${prefix};-DCMAKE_C_COMPILER=${COMPILER};-DWANTED=${VERSION}"
    "--build;${consumer_build}")
  execute_process(COMMAND ${CMAKE_COMMAND} ${step} RESULT_VARIABLE status OUTPUT_VARIABLE output ERROR_VARIABLE output)
  if(NOT status EQUAL 0)
    message(FATAL_ERROR "cmake ${step}\n${output}")
  endif()
endforeach()

execute_process(COMMAND ${consumer_build}/consumer RESULT_VARIABLE status)
if(NOT status EQUAL 0)
  message(FATAL_ERROR "the consumer built against the installed library returned ${status}")
endif()

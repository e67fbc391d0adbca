# Compiles every firmware source with the floating-point registers forbidden: any float or double in the code is then
# a compiler error. CHECK=refuses_float proves that the compiler does refuse.

set(flags -std=c11 -O2 -ffreestanding -mgeneral-regs-only -I${ROOT}/firmware -I${ROOT})
file(MAKE_DIRECTORY ${WORK})

function(compile source result)
  execute_process(COMMAND ${COMPILER} ${flags} -c ${source} -o ${WORK}/${CHECK}.o
                  RESULT_VARIABLE status ERROR_VARIABLE message)
  set(${result} ${status} PARENT_SCOPE)
  set(message "${message}" PARENT_SCOPE)
endfunction()

if(CHECK STREQUAL "refuses_float")
  file(WRITE ${WORK}/float.c "int scaled(int x);\nint scaled(int x)\n{\n    return (int)((double)x * 0.7);\n}\n")
  compile(${WORK}/float.c status)
  if(status EQUAL 0)
    message(FATAL_ERROR "${COMPILER} accepts floating point with -mgeneral-regs-only: this check proves nothing")
  endif()
  return()
endif()

file(GLOB sources ${ROOT}/firmware/core/*.c ${ROOT}/firmware/application/*.c)
if(NOT sources)
  message(FATAL_ERROR "no firmware sources below ${ROOT}/firmware")
endif()
set(failed)
foreach(source IN LISTS sources)
  compile(${source} status)
  if(NOT status EQUAL 0)
    list(APPEND failed ${source})
    message("${message}")
  endif()
endforeach()
if(failed)
  message(FATAL_ERROR "not integer-only or not freestanding: ${failed}")
endif()
list(LENGTH sources count)
message("${count} firmware sources use no floating point")

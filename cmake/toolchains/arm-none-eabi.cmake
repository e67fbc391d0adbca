# Cortex-M without an operating system. WINEGLASS_BOARD names the port in hal/, and with it the processor if that is known here;
# else WINEGLASS_PROCESSOR does.
set(CMAKE_SYSTEM_NAME Generic)
set(CMAKE_SYSTEM_PROCESSOR arm)
set(CMAKE_C_COMPILER arm-none-eabi-gcc)
set(CMAKE_TRY_COMPILE_TARGET_TYPE STATIC_LIBRARY)
set(CMAKE_TRY_COMPILE_PLATFORM_VARIABLES WINEGLASS_BOARD WINEGLASS_PROCESSOR)
set(CMAKE_EXECUTABLE_SUFFIX .elf)
set(CMAKE_FIND_ROOT_PATH_MODE_PROGRAM NEVER)
set(CMAKE_FIND_ROOT_PATH_MODE_LIBRARY ONLY)
set(CMAKE_FIND_ROOT_PATH_MODE_INCLUDE ONLY)
set(CMAKE_FIND_ROOT_PATH_MODE_PACKAGE ONLY)

set(wineglass_processor_mps2-an386 cortex-m4)
set(wineglass_processor_mps2-an500 cortex-m7)
set(wineglass_processor_stm32f405 cortex-m4)
if(DEFINED wineglass_processor_${WINEGLASS_BOARD})
  set(WINEGLASS_PROCESSOR ${wineglass_processor_${WINEGLASS_BOARD}})
elseif(NOT WINEGLASS_PROCESSOR)
  message(FATAL_ERROR "WINEGLASS_BOARD is \"${WINEGLASS_BOARD}\"; known are mps2-an386, mps2-an500 and stm32f405. "
                      "For a board of your own give WINEGLASS_PROCESSOR, too: cortex-m4, for example")
endif()

# No floating point anywhere in the firmware, so no floating-point registers either. The compiler writes the call graph with the
# stack of every function beside its objects (*.ci).
set(CMAKE_C_FLAGS_INIT
  "-mcpu=${WINEGLASS_PROCESSOR} -mthumb -mfloat-abi=soft -ffunction-sections -fdata-sections -fcallgraph-info=su")
set(CMAKE_EXE_LINKER_FLAGS_INIT "--specs=nano.specs -nostartfiles -Wl,--gc-sections")

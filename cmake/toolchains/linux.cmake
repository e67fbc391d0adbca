# A Linux machine of another kind, run through QEMU's user mode. WINEGLASS_MACHINE: armhf, arm64, riscv64, s390x or i386.
set(CMAKE_SYSTEM_NAME Linux)
set(CMAKE_TRY_COMPILE_PLATFORM_VARIABLES WINEGLASS_MACHINE)

# Machine -> compiler prefix, processor, emulator.
set(wineglass_machine_armhf arm-linux-gnueabihf arm qemu-arm)
set(wineglass_machine_arm64 aarch64-linux-gnu aarch64 qemu-aarch64)
set(wineglass_machine_riscv64 riscv64-linux-gnu riscv64 qemu-riscv64)
set(wineglass_machine_s390x s390x-linux-gnu s390x qemu-s390x)
set(wineglass_machine_i386 i686-linux-gnu i386 qemu-i386)
if(NOT DEFINED wineglass_machine_${WINEGLASS_MACHINE})
  message(FATAL_ERROR "WINEGLASS_MACHINE is \"${WINEGLASS_MACHINE}\"; known are armhf, arm64, riscv64, s390x and i386")
endif()
list(GET wineglass_machine_${WINEGLASS_MACHINE} 0 wineglass_prefix)
list(GET wineglass_machine_${WINEGLASS_MACHINE} 1 CMAKE_SYSTEM_PROCESSOR)
list(GET wineglass_machine_${WINEGLASS_MACHINE} 2 wineglass_emulator)

set(CMAKE_C_COMPILER ${wineglass_prefix}-gcc)
set(CMAKE_CROSSCOMPILING_EMULATOR ${wineglass_emulator};-L;/usr/${wineglass_prefix})
set(CMAKE_FIND_ROOT_PATH /usr/${wineglass_prefix})
set(CMAKE_FIND_ROOT_PATH_MODE_PROGRAM NEVER)

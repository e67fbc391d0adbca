#include "hal/stm32f405/watchdog.h"

#include "hal/stm32f405/clock.h"
#include "hal/stm32f405/registers.h"

#define KEY_UNLOCK 0x5555u
#define KEY_RELOAD 0xAAAAu
#define KEY_START  0xCCCCu

#define DIVIDE_BY_16 2u   /* of 32 kHz (17 .. 47 kHz) */
#define RELOAD       4095u
#define UPDATE_POLLS 200000 /* five cycles of its oscillator */

bool watchdog_start(void)
{
    IWDG_KR = KEY_START;
    IWDG_KR = KEY_UNLOCK;
    IWDG_PR = DIVIDE_BY_16;
    IWDG_RLR = RELOAD;
    bool taken = clock_wait(&IWDG_SR, IWDG_SR_PVU | IWDG_SR_RVU, 0, UPDATE_POLLS);
    IWDG_KR = KEY_RELOAD;
    return taken && IWDG_RLR == RELOAD && (RCC_CSR & RCC_CSR_LSIRDY) != 0;
}

void watchdog_kick(void *context)
{
    (void)context;
    IWDG_KR = KEY_RELOAD;
}

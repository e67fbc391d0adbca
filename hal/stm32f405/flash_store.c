#include "hal/stm32f405/flash_store.h"

#include "hal/hal.h"
#include "hal/stm32f405/clock.h"
#include "hal/stm32f405/converters.h"
#include "hal/stm32f405/registers.h"
#include "hal/stm32f405/watchdog.h"

#define KEY_1        UINT32_C(0x45670123)
#define KEY_2        UINT32_C(0xCDEF89AB)
#define FIRST_SECTOR 3
#define BUSY_POLLS   20000000 /* beyond a second, even if the processor did not stand still */
#define WORDS        2        /* code of 32 bits at a time: 2.7 to 3.6 V */
#define ERRORS       (FLASH_SR_OPERR | FLASH_SR_WRPERR | FLASH_SR_PGAERR | FLASH_SR_PGPERR | FLASH_SR_PGSERR)

static const uint32_t addresses[HAL_STORE_SECTORS] = {UINT32_C(0x0800C000), UINT32_C(0x08010000)};

static bool outside(uint32_t sector, uint32_t offset, uint32_t count)
{
    return sector >= HAL_STORE_SECTORS || offset > FLASH_STORE_SECTOR_BYTES || count > FLASH_STORE_SECTOR_BYTES - offset;
}

static bool unlock(void)
{
    if ((FLASH_CR & FLASH_CR_LOCK) != 0) {
        FLASH_KEYR = KEY_1;
        FLASH_KEYR = KEY_2;
    }
    FLASH_SR = ERRORS | FLASH_SR_EOP;
    return (FLASH_CR & FLASH_CR_LOCK) == 0;
}

/* What the data cache holds of the sector is no longer true. */
static void lock(void)
{
    FLASH_CR = FLASH_CR_LOCK;
    uint32_t acr = FLASH_ACR;
    FLASH_ACR = acr & ~FLASH_ACR_DCEN;
    FLASH_ACR = (acr & ~FLASH_ACR_DCEN) | FLASH_ACR_DCRST;
    FLASH_ACR = acr;
}

static bool finished(void)
{
    return clock_wait(&FLASH_SR, FLASH_SR_BSY, 0, BUSY_POLLS) && (FLASH_SR & ERRORS) == 0;
}

bool flash_store_check(void)
{
    bool was_locked = (FLASH_CR & FLASH_CR_LOCK) != 0;
    bool opens = unlock();
    FLASH_CR = FLASH_CR_LOCK;
    return was_locked && opens && (FLASH_CR & FLASH_CR_LOCK) != 0;
}

static bool erase(uint32_t number)
{
    FLASH_CR = FLASH_CR_PSIZE(WORDS) | FLASH_CR_SER | FLASH_CR_SNB(number);
    FLASH_CR = FLASH_CR_PSIZE(WORDS) | FLASH_CR_SER | FLASH_CR_SNB(number) | FLASH_CR_STRT;
    return finished();
}

int flash_store_erase(void *context, uint32_t sector)
{
    if (outside(sector, 0, 0)) {
        return HAL_ERROR_ADDRESS;
    }
    converters_pause();
    watchdog_kick(context);
    bool done = finished() && unlock() && erase(FIRST_SECTOR + sector);
    lock();
    watchdog_kick(context);
    converters_resume();
    return done ? HAL_OK : HAL_ERROR_STORE;
}

static bool program(uint32_t address, const uint8_t *bytes, uint32_t count)
{
    FLASH_CR = FLASH_CR_PSIZE(WORDS) | FLASH_CR_PG;
    for (uint32_t i = 0; i < count; i += FLASH_STORE_PROGRAM_BYTES) {
        uint32_t word = bytes[i] | (uint32_t)bytes[i + 1] << 8 | (uint32_t)bytes[i + 2] << 16 | (uint32_t)bytes[i + 3] << 24;
        REGISTER(address, i) = word;
        if (!finished()) {
            return false;
        }
    }
    return true;
}

int flash_store_program(void *context, uint32_t sector, uint32_t offset, const uint8_t *bytes, uint32_t count)
{
    (void)context;
    if (outside(sector, offset, count) || offset % FLASH_STORE_PROGRAM_BYTES != 0 || count % FLASH_STORE_PROGRAM_BYTES != 0) {
        return HAL_ERROR_ADDRESS;
    }
    converters_pause();
    bool done = finished() && unlock() && program(addresses[sector] + offset, bytes, count);
    lock();
    converters_resume();
    return done ? HAL_OK : HAL_ERROR_STORE;
}

int flash_store_read(void *context, uint32_t sector, uint32_t offset, uint8_t *bytes, uint32_t count)
{
    (void)context;
    if (outside(sector, offset, count)) {
        return HAL_ERROR_ADDRESS;
    }
    for (uint32_t i = 0; i < count; i++) {
        bytes[i] = *(const volatile uint8_t *)(uintptr_t)(addresses[sector] + offset + i);
    }
    return HAL_OK;
}

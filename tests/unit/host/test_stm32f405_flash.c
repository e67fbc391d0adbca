/* The STM32F405's flash driver against a model of that flash: key, lock, sector numbers, programming only what is erased and unlocked. The
 * model looks at what the driver has written whenever it touches the next register. */
#include <string.h>
#include <sys/mman.h>

#include "unity.h"

#include <stdint.h>

static volatile uint32_t *model_register(uint32_t address);
#define REGISTER(base, offset) (*model_register((base) + (offset)))

#include "../../../hal/stm32f405/flash_store.c"

#include "application/store.h"

#define MAPPED_START UINT32_C(0x08000000)
#define MAPPED_BYTES UINT32_C(0x20000)

enum { KEYR = 1, SR = 3, CR = 4 };

static uint32_t control[5];  /* as the driver sees them: ACR, KEYR, unused, SR, CR */
static uint8_t shadow[MAPPED_BYTES]; /* what the flash really holds */
static uint32_t keys_right, bad_manners, pauses, kicks;
static bool answers = true;

static uint8_t *mapped(void)
{
    return (uint8_t *)(uintptr_t)MAPPED_START;
}

static void look_at_key(void)
{
    if (control[KEYR] != 0) {
        keys_right = control[KEYR] == (keys_right == 0 ? KEY_1 : KEY_2) ? keys_right + 1 : 0;
        control[KEYR] = 0;
        if (keys_right == 2 && answers) {
            control[CR] &= ~FLASH_CR_LOCK;
        }
    }
}

static void look_at_erase(void)
{
    static const uint32_t start[5] = {0, 0x4000, 0x8000, 0xC000, 0x10000}, bytes[5] = {0x4000, 0x4000, 0x4000, 0x4000, 0x10000};
    if ((control[CR] & FLASH_CR_STRT) != 0) {
        uint32_t number = (control[CR] >> 3) & 0xF;
        bad_manners += (control[CR] & FLASH_CR_SER) == 0 || number < 3 || number > 4 ? 1 : 0;
        if (number <= 4) {
            memset(shadow + start[number], 0xFF, bytes[number]);
            memcpy(mapped() + start[number], shadow + start[number], bytes[number]);
        }
        control[CR] &= ~FLASH_CR_STRT;
    }
}

/* Programming clears bits, and only of words that are erased; without PG nothing happens but an error. */
static void look_at_words(void)
{
    for (uint32_t at = 0; at < MAPPED_BYTES; at += 4) {
        if (memcmp(mapped() + at, shadow + at, 4) != 0) {
            bool allowed = (control[CR] & FLASH_CR_PG) != 0 && (control[CR] & FLASH_CR_LOCK) == 0 &&
                           ((control[CR] >> 8) & 3) == 2 && memcmp(shadow + at, "\377\377\377\377", 4) == 0;
            bad_manners += allowed ? 0 : 1;
            memcpy(allowed ? shadow + at : mapped() + at, allowed ? mapped() + at : shadow + at, 4);
        }
    }
}

/* The lock bit can be set but not cleared by writing, and nothing else sticks while it is set. */
static volatile uint32_t *model_register(uint32_t address)
{
    static uint32_t last_control = FLASH_CR_LOCK;
    look_at_key();
    if ((last_control & FLASH_CR_LOCK) != 0 && keys_right < 2 && control[CR] != last_control) {
        bad_manners++;
        control[CR] = last_control;
    }
    if ((control[CR] & FLASH_CR_LOCK) != 0) {
        keys_right = keys_right == 2 ? 0 : keys_right;
    }
    look_at_erase();
    look_at_words();
    control[SR] = 0; /* never busy, no errors; writing ones cleared them */
    last_control = control[CR];
    if (address >= MAPPED_START && address < MAPPED_START + MAPPED_BYTES) {
        return (volatile uint32_t *)(uintptr_t)address;
    }
    return &control[(address - FLASH_BASE) / 4];
}

/* ---- what the driver needs of its neighbours ------------------------------------------------------------------------------------ */

bool clock_wait(const volatile uint32_t *address, uint32_t mask, uint32_t value, uint32_t polls)
{
    (void)polls;
    return (*address & mask) == value;
}

void converters_pause(void)
{
    pauses++;
}

void converters_resume(void)
{
    pauses--;
}

void watchdog_kick(void *context)
{
    (void)context;
    kicks++;
}

/* ---- tests ------------------------------------------------------------------------------------------------------------------------ */

void setUp(void)
{
    memset(shadow, 0x5A, sizeof shadow);
    memcpy(mapped(), shadow, sizeof shadow);
    memset(control, 0, sizeof control);
    control[CR] = FLASH_CR_LOCK;
    keys_right = bad_manners = pauses = kicks = 0;
    answers = true;
    model_register(FLASH_BASE); /* the model notes the locked flash */
    bad_manners = 0;
}

void tearDown(void)
{
    model_register(FLASH_BASE);
    TEST_ASSERT_EQUAL_UINT32(0, bad_manners);
    TEST_ASSERT_EQUAL_UINT32(0, pauses);
    TEST_ASSERT_BITS(FLASH_CR_LOCK, FLASH_CR_LOCK, control[CR]);
}

static void erasing_touches_one_sector(void)
{
    TEST_ASSERT_EQUAL_INT(HAL_OK, flash_store_erase(NULL, 0));
    TEST_ASSERT_EACH_EQUAL_UINT8(0xFF, mapped() + 0xC000, 0x4000);
    TEST_ASSERT_EACH_EQUAL_UINT8(0x5A, mapped(), 0xC000);
    TEST_ASSERT_EACH_EQUAL_UINT8(0x5A, mapped() + 0x10000, 0x10000);
    TEST_ASSERT_EQUAL_INT(HAL_OK, flash_store_erase(NULL, 1));
    TEST_ASSERT_EACH_EQUAL_UINT8(0xFF, mapped() + 0x10000, 0x4000);
    TEST_ASSERT_GREATER_OR_EQUAL_UINT32(2, kicks);
}

static void words_are_written_and_read_back(void)
{
    uint8_t bytes[32], back[32];
    for (unsigned i = 0; i < sizeof bytes; i++) {
        bytes[i] = (uint8_t)(17 * i + 3);
    }
    TEST_ASSERT_EQUAL_INT(HAL_OK, flash_store_erase(NULL, 1));
    TEST_ASSERT_EQUAL_INT(HAL_OK, flash_store_program(NULL, 1, FLASH_STORE_SECTOR_BYTES - 32, bytes, 32));
    TEST_ASSERT_EQUAL_INT(HAL_OK, flash_store_read(NULL, 1, FLASH_STORE_SECTOR_BYTES - 32, back, 32));
    TEST_ASSERT_EQUAL_UINT8_ARRAY(bytes, back, 32);
}

static void outside_is_refused(void)
{
    uint8_t bytes[8] = {0};
    TEST_ASSERT_EQUAL_INT(HAL_ERROR_ADDRESS, flash_store_erase(NULL, 2));
    TEST_ASSERT_EQUAL_INT(HAL_ERROR_ADDRESS, flash_store_program(NULL, 0, FLASH_STORE_SECTOR_BYTES - 4, bytes, 8));
    TEST_ASSERT_EQUAL_INT(HAL_ERROR_ADDRESS, flash_store_program(NULL, 0, 2, bytes, 4));
    TEST_ASSERT_EQUAL_INT(HAL_ERROR_ADDRESS, flash_store_program(NULL, 0, 0, bytes, 6));
    TEST_ASSERT_EQUAL_INT(HAL_ERROR_ADDRESS, flash_store_read(NULL, 0, UINT32_MAX, bytes, 2));
}

static void a_flash_that_ignores_its_key_is_noticed(void)
{
    TEST_ASSERT_TRUE(flash_store_check());
    answers = false;
    TEST_ASSERT_FALSE(flash_store_check());
    TEST_ASSERT_EQUAL_INT(HAL_ERROR_STORE, flash_store_erase(NULL, 0));
}

static void calibrations_alternate_between_the_sectors(void)
{
    static const struct hal_properties properties = {.store_sector_bytes = FLASH_STORE_SECTOR_BYTES,
                                                     .store_program_bytes = FLASH_STORE_PROGRAM_BYTES};
    static const struct hal port = {.properties = &properties, .store_erase = flash_store_erase,
                                    .store_program = flash_store_program, .store_read = flash_store_read};
    struct store_record found[HAL_STORE_SECTORS];
    uint8_t block[392], back[392];
    for (unsigned round = 0; round < 5; round++) {
        memset(block, (int)round + 1, sizeof block);
        TEST_ASSERT_EQUAL_INT(HAL_OK, store_write(&port, block, sizeof block));
        TEST_ASSERT_EQUAL_UINT32(round == 0 ? 1 : 2, store_find(&port, sizeof block, found));
        TEST_ASSERT_EQUAL_UINT32(round % 2, found[0].sector);
        TEST_ASSERT_EQUAL_INT(HAL_OK, store_read(&port, &found[0], back));
        TEST_ASSERT_EQUAL_UINT8_ARRAY(block, back, sizeof block);
    }
}

int main(void)
{
    void *wanted = mapped();
    if (mmap(wanted, MAPPED_BYTES, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_FIXED_NOREPLACE, -1, 0) != wanted) {
        return 0; /* this process has something else at the flash's address */
    }
    UNITY_BEGIN();
    RUN_TEST(erasing_touches_one_sector);
    RUN_TEST(words_are_written_and_read_back);
    RUN_TEST(outside_is_refused);
    RUN_TEST(a_flash_that_ignores_its_key_is_noticed);
    RUN_TEST(calibrations_alternate_between_the_sectors);
    return UNITY_END();
}

#include "hal/stm32f405/self_test.h"

#include "application/crc32.h"
#include "hal/stm32f405/converters.h"
#include "hal/stm32f405/flash_store.h"
#include "hal/stm32f405/registers.h"
#include "hal/stm32f405/startup.h"
#include "hal/stm32f405/thermometer.h"
#include "hal/stm32f405/ticks.h"
#include "hal/stm32f405/watchdog.h"

#define CONVERTERS_PATIENCE_MS       100 /* from the end of its reset to samples that mean something */
#define THERMOMETER_PATIENCE_MS 20
#define ODD_CONSTANT            UINT64_C(0x9E3779B97F4A7C15) /* spreads the third word over all bits */

extern const uint8_t image_start[], image_end[];
extern const uint32_t image_crc;

static void note(struct hal_self_test *test, enum hal_part part, bool works)
{
    test->checked |= part;
    test->failed |= works ? 0 : part;
}

uint64_t self_test_unique_id(void)
{
    uint32_t words[3];
    for (uint32_t i = 0; i < 3; i++) {
        if (!startup_probe(UNIQUE_ID_ADDRESS + 4 * i, &words[i]) || words[i] == UINT32_MAX) {
            return 0;
        }
    }
    return ((uint64_t)words[1] << 32 | words[0]) ^ words[2] * ODD_CONSTANT;
}

/* The volatile keeps the compiler from knowing the value that is set into the image after the linker. */
static bool image_is_sound(void)
{
    const volatile uint32_t *sealed = &image_crc;
    return crc32_update(0, image_start, (uintptr_t)image_end - (uintptr_t)image_start) == *sealed;
}

static bool thermometer_answers(void)
{
    int32_t raw;
    uint32_t first_ms = ticks_ms();
    bool answers = thermometer_read(NULL, &raw);
    while (!answers && ticks_ms() - first_ms < THERMOMETER_PATIENCE_MS) {
        answers = thermometer_read(NULL, &raw);
    }
    return answers;
}

/* Samples are not asked for without their clock. */
static void test_converters(struct hal_self_test *test, struct clock clock)
{
    if (clock.sample_clock) {
        uint32_t first_ms = ticks_ms();
        converters_start();
        while (ticks_ms() - first_ms < CONVERTERS_PATIENCE_MS) {
        }
    }
    bool frames = converters_frames() > 0;
    note(test, HAL_PART_CONVERTERS, frames);
    if (frames) {
        note(test, HAL_PART_PICKOFFS, converters_move());
    }
}

/* The cause stays until it is cleared; power alone leaves no watchdog bit. */
static bool last_run_ended_well(struct hal_self_test *test)
{
    bool watchdog = (RCC_CSR & RCC_CSR_WDGRSTF) != 0;
    RCC_CSR |= RCC_CSR_RMVF;
    test->fault_address = startup_take_fault_address();
    return !watchdog && test->fault_address == 0;
}

struct hal_self_test self_test_run(struct clock clock)
{
    struct hal_self_test test = {0, 0, clock.core_hz, 0, 0};
    note(&test, HAL_PART_CRYSTAL, clock.crystal);
    note(&test, HAL_PART_CORE_CLOCK, clock.full_speed);
    note(&test, HAL_PART_SAMPLE_CLOCK, clock.sample_clock);
    note(&test, HAL_PART_LAST_RUN, last_run_ended_well(&test));
    note(&test, HAL_PART_MEMORY, startup_memory_is_sound());
    note(&test, HAL_PART_IMAGE, image_is_sound());
    note(&test, HAL_PART_UNIQUE_ID, self_test_unique_id() != 0);
    note(&test, HAL_PART_STORE, flash_store_check());
    thermometer_start(clock.apb1_hz);
    note(&test, HAL_PART_THERMOMETER, thermometer_answers());
    test_converters(&test, clock);
    note(&test, HAL_PART_WATCHDOG, watchdog_start());
    return test;
}

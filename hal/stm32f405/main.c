/* The device: application, port and board put together. */
#include "application/application.h"
#include "hal/stm32f405/board.h"
#include "hal/stm32f405/clock.h"
#include "hal/stm32f405/converters.h"
#include "hal/stm32f405/flash_store.h"
#include "hal/stm32f405/self_test.h"
#include "hal/stm32f405/serial.h"
#include "hal/stm32f405/startup.h"
#include "hal/stm32f405/thermometer.h"
#include "hal/stm32f405/ticks.h"
#include "hal/stm32f405/watchdog.h"

static struct application application;
static struct hal_properties properties;
static struct hal_self_test self_test;
static _Atomic bool silent;     /* no converters: silence at 1 kHz instead, so that status and link can be tried */
static uint32_t frames_at_kick; /* when the sample path was last seen alive */

/* ---- interrupt ----------------------------------------------------------------------------------------------------------------- */

void converters_frame(const int32_t adc_raw[2], int32_t dac_raw[2])
{
    application_sample(&application, adc_raw, dac_raw);
}

void ticks_every_ms(void)
{
    static const int32_t quiet[2] = {0, 0};
    int32_t nowhere[2];
    if (atomic_load_explicit(&silent, memory_order_relaxed)) {
        application_sample(&application, quiet, nowhere);
    }
}

/* ---- background ---------------------------------------------------------------------------------------------------------------- */

static uint64_t time_us(void *context)
{
    (void)context;
    return ticks_us();
}

/* Called from the main loop, it stands for the background; the frames stand for the interrupt. */
static void kick_while_alive(void *context)
{
    uint32_t frames = converters_frames();
    if (frames != frames_at_kick || atomic_load_explicit(&silent, memory_order_relaxed)) {
        frames_at_kick = frames;
        watchdog_kick(context);
    }
    self_test.samples_lost = converters_samples_lost();
}

static const struct hal port = {
    .properties = &properties,
    .self_test = &self_test,
    .bytes_write = serial_write,
    .bytes_read = serial_read,
    .thermometer_read_raw = thermometer_read,
    .time_us = time_us,
    .store_erase = flash_store_erase,
    .store_program = flash_store_program,
    .store_read = flash_store_read,
    .watchdog_kick = kick_while_alive,
};

static void describe_board(void)
{
    properties = (struct hal_properties){
        .unique_id = self_test_unique_id(),
        .sample_rate_millihz = BOARD_SAMPLE_RATE_MILLIHZ,
        .adc_bits = BOARD_CONVERTER_BITS,
        .dac_bits = BOARD_CONVERTER_BITS,
        .loop_delay_samples_q16 = BOARD_LOOP_DELAY_Q16,
        .store_sector_bytes = FLASH_STORE_SECTOR_BYTES,
        .store_program_bytes = FLASH_STORE_PROGRAM_BYTES,
    };
}

int main(void)
{
    struct clock clock = clock_set_up();
    ticks_start(clock.core_hz);
    serial_start(clock.apb2_hz);
    self_test = self_test_run(clock);
    describe_board();
    if (application_init(&application, &port) != 0) {
        startup_reset(); /* cannot be: the block that is compiled in suits the board, which a test holds */
    }
    if ((self_test.failed & HAL_PART_CONVERTERS) == 0) {
        converters_connect();
    } else {
        atomic_store_explicit(&silent, true, memory_order_relaxed);
    }
    for (;;) {
        application_poll(&application);
        __asm__ volatile("wfi");
    }
}

#include "hal/stm32f405/converters.h"

#include <stdatomic.h>

#include "hal/stm32f405/board.h"

#define PAUSE_POLLS 1000000

enum mode { MODE_SILENT, MODE_CONNECTED };

static _Atomic uint32_t mode, frames, samples_lost;
static int32_t low[2] = {INT32_MAX, INT32_MAX}, high[2] = {INT32_MIN, INT32_MIN}; /* extremes of the codes until connected */

/* ---- interrupt ----------------------------------------------------------------------------------------------------------------- */

static bool connected(void)
{
    return atomic_load_explicit(&mode, memory_order_relaxed) == MODE_CONNECTED;
}

static void watch(const int32_t adc_raw[2])
{
    for (unsigned channel = 0; channel < 2; channel++) {
        low[channel] = adc_raw[channel] < low[channel] ? adc_raw[channel] : low[channel];
        high[channel] = adc_raw[channel] > high[channel] ? adc_raw[channel] : high[channel];
    }
}

void converters_exchange(const int32_t adc_raw[2], int32_t dac_raw[2])
{
    dac_raw[0] = dac_raw[1] = 0;
    if (connected()) {
        converters_frame(adc_raw, dac_raw);
    } else {
        watch(adc_raw);
    }
    atomic_fetch_add_explicit(&frames, 1, memory_order_relaxed);
}

void converters_note_lost(uint32_t lost)
{
    if (connected()) {
        atomic_fetch_add_explicit(&samples_lost, lost, memory_order_relaxed);
    }
}

/* ---- background ---------------------------------------------------------------------------------------------------------------- */

uint32_t converters_frames(void)
{
    return atomic_load_explicit(&frames, memory_order_relaxed);
}

uint32_t converters_samples_lost(void)
{
    return atomic_load_explicit(&samples_lost, memory_order_relaxed);
}

/* A converter that works never repeats itself to the last bit. */
bool converters_move(void)
{
    atomic_signal_fence(memory_order_acquire);
    return low[0] < high[0] && low[1] < high[1];
}

void converters_connect(void)
{
    atomic_store_explicit(&mode, MODE_CONNECTED, memory_order_relaxed);
}

/* All blocks hold zeros after two more interrupts; a third makes sure. Without running converters there is nothing to wait for. */
void converters_pause(void)
{
    atomic_store_explicit(&mode, MODE_SILENT, memory_order_relaxed);
    uint32_t first = converters_frames();
    for (uint32_t i = 0; i < PAUSE_POLLS && first != 0 && converters_frames() - first < 3 * BOARD_BLOCK_FRAMES; i++) {
    }
}

/* What the driver has missed meanwhile belongs to the pause and is no loss. */
void converters_resume(void)
{
    converters_driver_forget();
    if (converters_frames() != 0) {
        converters_connect();
    }
}

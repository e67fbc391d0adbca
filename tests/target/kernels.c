/* Every kernel of the sample path, many times, with arguments over its whole range: the instruction counter watches the functions.
 * Kernels that live in headers stand in functions of their own here, named cost_*. */
#include <stdint.h>

#include "core/dac_shaper.h"
#include "core/decoupler.h"
#include "core/drive_loop.h"
#include "core/lockin.h"
#include "core/oscillator.h"
#include "core/output_filter.h"
#include "core/polar.h"
#include "core/rate.h"
#include "core/rebalance.h"
#include "core/thermal_polynomial.h"

#define ROUNDS 4000
#define KERNEL __attribute__((noinline, noclone, used))

struct phasor_q30 cost_cosine_sine(uint32_t phase_u32);
void cost_lockin_pair(struct lockin_state pair[2], int32_t primary_q31, int32_t secondary_q31, const struct phasor_q30 *phasor);
int32_t cost_decoupler(const struct decoupler_coefs *coefs, struct decoupler_state *state, int32_t primary_q31, bool *overflow);
int32_t cost_dac_shaper(struct dac_shaper_state *state, int32_t force_q31, int32_t two_cos_q30, bool *saturated);

static uint64_t counter;
static volatile int32_t sink;
static bool flag;

/* A counter through the finaliser of splitmix64: the same numbers every time. */
static uint32_t random_u32(void)
{
    counter += UINT64_C(0x9E3779B97F4A7C15);
    uint64_t x = (counter ^ (counter >> 30)) * UINT64_C(0xBF58476D1CE4E5B9);
    x = (x ^ (x >> 27)) * UINT64_C(0x94D049BB133111EB);
    return (uint32_t)(x ^ (x >> 31));
}

static int32_t random_i32(unsigned bits)
{
    return (int32_t)random_u32() >> (32 - bits);
}

static struct complex_q30 random_complex(unsigned bits)
{
    return (struct complex_q30){random_i32(bits), random_i32(bits)};
}

KERNEL struct phasor_q30 cost_cosine_sine(uint32_t phase_u32)
{
    return oscillator_phasor(phase_u32);
}

KERNEL void cost_lockin_pair(struct lockin_state pair[2], int32_t primary_q31, int32_t secondary_q31, const struct phasor_q30 *phasor)
{
    struct lockin_reference reference = lockin_reference(5, *phasor);
    lockin_step(&pair[0], primary_q31, reference);
    lockin_step(&pair[1], secondary_q31, reference);
}

KERNEL int32_t cost_decoupler(const struct decoupler_coefs *coefs, struct decoupler_state *state, int32_t primary_q31, bool *overflow)
{
    return decoupler_step(coefs, state, primary_q31, overflow);
}

KERNEL int32_t cost_dac_shaper(struct dac_shaper_state *state, int32_t force_q31, int32_t two_cos_q30, bool *saturated)
{
    return dac_shaper_step(state, force_q31, two_cos_q30, 0xFFFF, saturated);
}

static void every_sample(void)
{
    static struct lockin_state lockin[2];
    static struct decoupler_state decoupler;
    static struct dac_shaper_state shaper;
    struct decoupler_coefs coefs = {random_i32(31), random_i32(31), random_i32(6), (int32_t)(random_u32() >> 8) - (1 << 30), random_i32(6)};
    struct phasor_q30 phasor = cost_cosine_sine(random_u32());
    cost_lockin_pair(lockin, random_i32(32) >> 12, random_i32(32) >> 12, &phasor);
    sink = cost_decoupler(&coefs, &decoupler, random_i32(32), &flag);
    sink = cost_dac_shaper(&shaper, random_i32(32), random_i32(32), &flag);
}

static const struct drive_loop_cfg drive_cfg = {
    .pll_proportional_q32 = 1u << 22, .pll_integral_q32 = 1u << 14, .freq_min_u64 = UINT64_C(1) << 60,
    .freq_max_u64 = UINT64_C(3) << 60, .amplitude_q30 = 1 << 29, .agc_proportional_q16 = 1 << 20, .agc_integral_q24 = 1 << 18,
    .drive_max_q31 = INT32_MAX,
};

static const struct rebalance_cfg rebalance_cfg = {1 << 20, 1 << 18, 1 << 30, 1 << 30};

static void every_loop_tick(void)
{
    static struct drive_loop_state drive = {.freq_u64 = UINT64_C(2) << 60, .freq_integral_u64 = UINT64_C(2) << 60};
    static struct rebalance_state rebalance;
    static struct lockin_state lockin;
    const struct lockin_cfg lockin_cfg = {10, 85899346, 5};
    struct polar polar = polar_from_complex(random_complex(1 + (random_u32() % 31)));
    drive_loop_step(&drive_cfg, &drive, polar);
    rebalance_step(&rebalance_cfg, &rebalance, random_complex(31));
    lockin.in_phase.ramp = random_u32();
    sink = lockin_output(&lockin_cfg, &lockin).i_q30;
}

static void every_slow_tick(void)
{
    static struct output_filter_state filter;
    static struct decoupler_coefs coefs;
    const struct decoupler_tuning tuning = { /* 5 kHz at 50 kSa/s */
        UINT64_C(1844674407370955161), INT64_C(1779059999875), 1737350766, 1262259218, 1407374884, 703687442,
    };
    struct thermal_polynomial polynomial = {.order = THERMAL_POLYNOMIAL_MAX_ORDER};
    for (unsigned i = 0; i <= THERMAL_POLYNOMIAL_MAX_ORDER; i++) {
        polynomial.coef[i] = random_i32(32 - (random_u32() & 7));
    }
    uint64_t freq_u64 = tuning.center_freq_u64 + (uint64_t)((int64_t)random_i32(32) * (1 << 23));
    sink = thermal_polynomial_eval(&polynomial, random_i32(32), &flag);
    sink = decoupler_retune(&tuning, freq_u64, random_i32(31) & 0x0FFFFFFF, random_i32(22), &coefs);
    sink = rate_ratio_q29(random_complex(1 + (random_u32() % 31)), random_complex(31), &flag).in_phase_q29;
    sink = output_filter_step(OUTPUT_FILTER_0_05, &filter, random_i32(32), &flag);
}

int main(void)
{
    for (unsigned round = 0; round < ROUNDS; round++) {
        every_sample();
        every_loop_tick();
        every_slow_tick();
    }
    return 0;
}

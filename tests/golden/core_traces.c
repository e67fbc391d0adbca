/* Integer traces of every kernel of the core and of a whole gyro run: a change of any bit shows in core_traces.txt.
 * Inputs are integers from a counter; nothing depends on a library's sine or on the order of floating-point sums. */
#include <inttypes.h>
#include <stdio.h>

#include "core/dac_shaper.h"
#include "core/gyro.h"
#include "support/gyro_fixture.h"
#include "support/random.h"

#define FNV_OFFSET UINT64_C(0xCBF29CE484222325)
#define FNV_PRIME UINT64_C(0x100000001B3)

struct trace {
    const char *name;
    uint64_t hash, count;
    int64_t shown[6]; /* values number 1, 10, 100 .. */
    unsigned shown_count;
};

static struct trace trace_begin(const char *name)
{
    return (struct trace){.name = name, .hash = FNV_OFFSET};
}

static void trace_add(struct trace *trace, int64_t value)
{
    static const uint64_t show_at[] = {1, 10, 100, 1000, 10000, 100000};
    for (int byte = 0; byte < 8; byte++) {
        trace->hash = (trace->hash ^ (((uint64_t)value >> (8 * byte)) & 0xFF)) * FNV_PRIME;
    }
    trace->count++;
    if (trace->shown_count < 6 && trace->count == show_at[trace->shown_count]) {
        trace->shown[trace->shown_count++] = value;
    }
}

static void trace_end(const struct trace *trace)
{
    printf("%-22s %7" PRIu64 "  %016" PRIx64 " ", trace->name, trace->count, trace->hash);
    for (unsigned k = 0; k < trace->shown_count; k++) {
        printf(" %" PRId64, trace->shown[k]);
    }
    printf("\n");
}

static void trace_oscillator(void)
{
    struct trace cosine = trace_begin("oscillator cosine"), sine = trace_begin("oscillator sine");
    struct oscillator_state state = {0, UINT64_C(0x199A2B3C4D5E6F70)};
    for (int n = 0; n < 100000; n++) {
        struct phasor_q30 phasor = oscillator_phasor(oscillator_step(&state));
        trace_add(&cosine, phasor.cosine_q30);
        trace_add(&sine, phasor.sine_q30);
    }
    trace_end(&cosine);
    trace_end(&sine);
}

static void trace_lockin(void)
{
    struct trace in_phase = trace_begin("lock-in in phase"), quadrature = trace_begin("lock-in quadrature");
    struct random_state random = {1};
    struct lockin_cfg cfg = {10, 85899346, lockin_reference_shift(10)};
    struct lockin_state state;
    struct oscillator_state oscillator = {0, UINT64_C(0x199A2B3C4D5E6F70)};
    lockin_reset(&state);
    for (int n = 1; n <= 100000; n++) {
        struct lockin_reference reference = lockin_reference(cfg.reference_shift, oscillator_phasor(oscillator_step(&oscillator)));
        lockin_step(&state, random_wide_i32(&random), reference);
        if (n % 10 == 0) {
            struct complex_q30 out = lockin_output(&cfg, &state);
            trace_add(&in_phase, out.i_q30);
            trace_add(&quadrature, out.q_q30);
        }
    }
    trace_end(&in_phase);
    trace_end(&quadrature);
}

static void trace_decoupler(void)
{
    struct trace words = trace_begin("decoupler tuning"), out = trace_begin("decoupler output");
    struct random_state random = {2};
    struct decoupler_tuning tuning = fixture_tuning(50e3, 5000.0, 2.0);
    struct decoupler_state state;
    bool overflow = false;
    decoupler_reset(&state);
    for (int retune = 0; retune < 1000; retune++) {
        struct decoupler_coefs coefs = {0, 0, 0, 0, 0};
        uint64_t freq = tuning.center_freq_u64 + (uint64_t)((int64_t)random_u64(&random) >> 9);
        trace_add(&words, decoupler_retune(&tuning, freq, 1 << (12 + retune % 18), random_wide_i32(&random) >> 8, &coefs));
        trace_add(&words, coefs.minus_gain_q48);
        trace_add(&words, coefs.a1_q30);
        trace_add(&words, coefs.a1_low_q36);
        trace_add(&words, coefs.minus_r2_q30);
        trace_add(&words, coefs.minus_r2_low_q36);
        for (int n = 0; n < 100; n++) {
            trace_add(&out, decoupler_step(&coefs, &state, random_i32(&random), &overflow));
        }
    }
    trace_add(&out, overflow);
    trace_end(&words);
    trace_end(&out);
}

/* One after the other: C leaves the order within an initialiser open. */
static struct complex_q30 random_complex(struct random_state *random, unsigned shift)
{
    int32_t i_q30 = random_wide_i32(random) >> shift;
    int32_t q_q30 = random_wide_i32(random) >> shift;
    return (struct complex_q30){i_q30, q_q30};
}

static void trace_polar_and_rate(void)
{
    struct trace magnitude = trace_begin("polar magnitude"), angle = trace_begin("polar angle");
    struct trace ratio = trace_begin("rate ratio"), scaled = trace_begin("rate scaled"), removed = trace_begin("rate removed");
    struct random_state random = {3};
    struct rate_state state = {0};
    for (int n = 0; n < 100000; n++) {
        struct complex_q30 primary = random_complex(&random, 1), secondary = random_complex(&random, 1);
        struct polar polar = polar_from_complex(primary);
        bool overflow = false;
        struct rate_ratio both_q29 = rate_ratio_q29(primary, secondary, &overflow);
        int32_t ratio_q29 = both_q29.in_phase_q29;
        trace_add(&magnitude, polar.magnitude_q30);
        trace_add(&angle, polar.angle_i32);
        trace_add(&ratio, ratio_q29);
        trace_add(&ratio, both_q29.quadrature_q29);
        trace_add(&scaled, rate_scale_q28(ratio_q29, random_wide_i32(&random), &overflow));
        trace_add(&scaled, overflow);
        int32_t bias = random_wide_i32(&random), decay = random_wide_i32(&random) & INT32_MAX;
        trace_add(&removed, rate_removed_step_q28(&state, bias, decay));
    }
    trace_end(&magnitude);
    trace_end(&angle);
    trace_end(&ratio);
    trace_end(&scaled);
    trace_end(&removed);
}

static void trace_polynomial(void)
{
    struct trace values = trace_begin("thermal polynomial");
    struct random_state random = {4};
    for (int n = 0; n < 100000; n++) {
        struct thermal_polynomial polynomial = {.order = (uint32_t)(n % 7)};
        bool overflow = false;
        for (int i = 0; i < 6; i++) {
            polynomial.coef[i] = random_wide_i32(&random);
        }
        int32_t argument = thermal_polynomial_argument(random_wide_i32(&random), &overflow);
        trace_add(&values, thermal_polynomial_eval(&polynomial, argument, &overflow));
        trace_add(&values, overflow);
    }
    trace_end(&values);
}

static void trace_output_filter(void)
{
    static const char *const names[] = {"output filter none", "output filter 0.01", "output filter 0.025", "output filter 0.05",
                                        "output filter 0.1"};
    for (uint32_t choice = 0; choice < OUTPUT_FILTER_COUNT; choice++) {
        struct trace values = trace_begin(names[choice]);
        struct random_state random = {5};
        struct output_filter_state state;
        bool overflow = false;
        output_filter_reset(&state, 1000);
        for (int n = 0; n < 10000; n++) {
            trace_add(&values, output_filter_step(choice, &state, random_wide_i32(&random), &overflow));
        }
        trace_add(&values, overflow);
        trace_end(&values);
    }
}

static void trace_loops(void)
{
    struct trace drive = trace_begin("drive loop"), rebalance = trace_begin("rebalance");
    struct random_state random = {6};
    struct fixture_device device = fixture_default();
    struct gyro_cfg cfg = fixture_cfg(&device);
    struct drive_loop_state drive_state;
    struct rebalance_state rebalance_state;
    drive_loop_reset(&drive_state, cfg.tuning.center_freq_u64, 1 << 30);
    rebalance_reset(&rebalance_state);
    for (int n = 0; n < 20000; n++) {
        struct complex_q30 words = random_complex(&random, 6);
        struct polar reading = {cfg.drive.amplitude_q30 + words.i_q30, words.q_q30};
        drive_loop_step(&cfg.drive, &drive_state, reading);
        trace_add(&drive, (int64_t)drive_state.freq_u64);
        trace_add(&drive, drive_state.drive_q31);
        rebalance_step(&cfg.rebalance, &rebalance_state, random_complex(&random, 3));
        trace_add(&rebalance, rebalance_state.in_phase.force_q31);
        trace_add(&rebalance, rebalance_state.quadrature.force_q31);
    }
    trace_end(&drive);
    trace_end(&rebalance);
}

static void trace_shaper_and_test_signal(void)
{
    struct trace codes = trace_begin("DAC shaper"), forces = trace_begin("test signal");
    struct random_state random = {7};
    struct dac_shaper_state shaper = {0, 0};
    struct test_signal_cfg cfg = {1 << 30, -(1 << 29), 12345678};
    struct test_signal_state signal = {0};
    bool saturated = false;
    for (int n = 0; n < 20000; n++) {
        uint32_t mask = (UINT32_C(1) << (n / 1000)) - 1;
        trace_add(&codes, dac_shaper_step(&shaper, random_wide_i32(&random), 1737350767, mask, &saturated));
        trace_add(&codes, saturated);
        struct test_signal_force force = test_signal_step(&cfg, &signal);
        trace_add(&forces, force.in_phase_q31);
        trace_add(&forces, force.quadrature_q31);
    }
    trace_end(&codes);
    trace_end(&forces);
}

/* A tone of 5004.9 Hz at 0.9 on the primary, a tenth of it 30 degrees ahead on the secondary, noise of a few codes: 16-bit codes. */
static struct gyro_input synthetic_code(struct oscillator_state *tone, struct random_state *random, int thermometer_raw)
{
    uint32_t phase = oscillator_step(tone);
    int32_t noise[2] = {random_i32(random) >> 30, random_i32(random) >> 30};
    int32_t primary = oscillator_phasor(phase).cosine_q30 / 32768 * 9 / 10 + noise[0];
    int32_t secondary = oscillator_phasor(phase + UINT32_C(357913941)).cosine_q30 / 32768 * 9 / 100 + noise[1];
    return (struct gyro_input){primary * 65536, secondary * 65536, thermometer_raw};
}

static void show_signals(const char *name, int second_tenths, const struct gyro_state *state)
{
    const struct gyro_signals *signals = &state->signals;
    printf("%s %4d.%d s  status %04x  freq %016" PRIx64 "  primary %11d %11d  secondary %11d %11d  drive %10d  rebalance %10d %10d"
           "  rate %9d %9d  angle %016" PRIx64 "\n",
           name, second_tenths / 10, second_tenths % 10, signals->status, signals->freq_u64, signals->primary.i_q30,
           signals->primary.q_q30, signals->secondary.i_q30, signals->secondary.q_q30, signals->drive_level_q31,
           signals->rebalance_in_phase_q31, signals->rebalance_quadrature_q31, signals->rate_rad_s_q28,
           signals->rate_uncompensated_rad_s_q28, signals->angle_u64);
}

static void trace_gyro(const char *name, uint32_t loop, uint32_t compensation)
{
    struct trace codes = trace_begin(name);
    struct fixture_device device = fixture_default();
    struct random_state random = {8};
    struct oscillator_state tone = {0, (UINT64_C(1) << 63) / 50000 * 10009 + 4243};
    struct gyro_state state;
    device.loop = loop;
    device.compensation = compensation;
    device.bias_rad_s = 1.08e-3;
    struct gyro_cfg cfg = fixture_cfg(&device);
    cfg.bias_rad_s_q31 = (struct thermal_polynomial){{2317563, -12729726, 27107000, -26389900, 0, 0}, 3};
    cfg.output_filter = OUTPUT_FILTER_0_05;
    gyro_reset(&cfg, &state);
    for (int n = 0; n < 150000; n++) {
        struct gyro_input input = synthetic_code(&tone, &random, n > 120000 ? GYRO_THERMOMETER_INVALID : n * 16);
        struct gyro_output output = gyro_step(&cfg, &state, &input);
        trace_add(&codes, output.drive_q31);
        trace_add(&codes, output.rebalance_q31);
        if (output.slow_tick) {
            trace_add(&codes, state.signals.rate_rad_s_q28);
        }
        if ((n + 1) % 15000 == 0) {
            show_signals(name, (n + 1) / 5000, &state);
        }
    }
    trace_end(&codes);
}

int main(void)
{
    trace_oscillator();
    trace_lockin();
    trace_decoupler();
    trace_polar_and_rate();
    trace_polynomial();
    trace_output_filter();
    trace_loops();
    trace_shaper_and_test_signal();
    trace_gyro("gyro open, none", GYRO_LOOP_OPEN, GYRO_COMPENSATION_NONE);
    trace_gyro("gyro open, static", GYRO_LOOP_OPEN, GYRO_COMPENSATION_STATIC);
    trace_gyro("gyro open, G2", GYRO_LOOP_OPEN, GYRO_COMPENSATION_G2);
    trace_gyro("gyro rebalance", GYRO_LOOP_REBALANCE, GYRO_COMPENSATION_STATIC);
    return 0;
}

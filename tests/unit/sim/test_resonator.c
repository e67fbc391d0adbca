/* The resonator against closed forms: decay, frequency, Coriolis response and its sign, quadrature, temperature laws. */
#include <math.h>
#include <string.h>

#include "sim/resonator.h"
#include "sim/twin.h"
#include "unity.h"

enum { RATE_HZ = 50000, MAX_SAMPLES = 200000 };

static const double pi = 3.14159265358979323846;
static double trajectory[MAX_SAMPLES][4];
static double forces[MAX_SAMPLES][2];

void setUp(void) { memset(forces, 0, sizeof forces); }
void tearDown(void) {}

static struct resonator_cfg plain(double quality)
{
    return (struct resonator_cfg){.reference_degc = 25.0, .frequency_hz = 5000.0, .quality_factor = quality,
                                  .quality_knee_degc = 1000.0, .angular_gain = 2.0, .drive_force_fs_s2 = 1e6,
                                  .rebalance_force_fs_s2 = 2e6};
}

static void run(const struct resonator_cfg *cfg, double rate_rad_s, uint64_t samples, double state[4])
{
    TEST_ASSERT_EQUAL_INT32(TWIN_OK, plant_run(cfg, RATE_HZ, (uint32_t)samples, 1, NULL, &rate_rad_s, NULL, &forces[0][0], state,
                                               &trajectory[0][0]));
}

static struct resonator_coefs coefs_of(const struct resonator_cfg *cfg, double degc, double rate_rad_s)
{
    struct resonator resonator;
    struct resonator_coefs coefs;
    resonator_init(cfg, &resonator);
    resonator_coefs_at(&resonator, degc, rate_rad_s, 0.0, &coefs);
    return coefs;
}

struct phasor {
    double i, q;
};

/* x = Re((i + j q) e^(j w t)) over n samples from first (whole periods), t = sample number / rate. */
static struct phasor amplitude(int coordinate, int first, int n, double freq_hz)
{
    struct phasor sum = {0, 0};
    for (int s = first; s < first + n; s++) {
        double phase = 2.0 * pi * freq_hz * (s + 1) / RATE_HZ;
        sum.i += 2.0 / n * trajectory[s][coordinate] * cos(phase);
        sum.q -= 2.0 / n * trajectory[s][coordinate] * sin(phase);
    }
    return sum;
}

static void drive_at(double freq_hz, double level, int n)
{
    for (int s = 0; s < n; s++) {
        forces[s][0] = level * cos(2.0 * pi * freq_hz * s / RATE_HZ);
    }
}

/* x = e^(-z k t) (cos wt + z k / w sin wt), w = k sqrt(1 - z^2). */
static void free_decay_is_the_closed_form(void)
{
    struct resonator_cfg cfg = plain(1e4);
    double state[4] = {0.9, 0.0, 0.0, 0.0};
    run(&cfg, 0.0, MAX_SAMPLES, state);
    double k = 2.0 * pi * 5000.0, z = 0.5e-4, w = k * sqrt(1.0 - z * z);
    for (int s = 0; s < MAX_SAMPLES; s += 1) {
        double t = (s + 1.0) / RATE_HZ;
        double x = 0.9 * exp(-z * k * t) * (cos(w * t) + z * k / w * sin(w * t));
        double v = -0.9 * exp(-z * k * t) * (k * k / w) * sin(w * t);
        TEST_ASSERT_DOUBLE_WITHIN(2e-10, x, trajectory[s][0]);
        TEST_ASSERT_DOUBLE_WITHIN(2e-10 * k, v, trajectory[s][1]);
        TEST_ASSERT_EQUAL_DOUBLE(0.0, trajectory[s][2]);
    }
}

static void held_force_ends_in_the_static_deflection(void)
{
    struct resonator_cfg cfg = plain(50.0);
    for (int s = 0; s < MAX_SAMPLES; s++) {
        forces[s][0] = 0.5;
        forces[s][1] = -0.25;
    }
    double state[4] = {0};
    double k = 2.0 * pi * 5000.0;
    run(&cfg, 0.0, 20000, state);
    TEST_ASSERT_DOUBLE_WITHIN(1e-17, 0.5 * 1e6 / (k * k), state[0]);
    TEST_ASSERT_DOUBLE_WITHIN(1e-17, -0.25 * 2e6 / (k * k), state[2]);
}

/* Driven at k the displacement lags the force by 90 degrees; the held force itself lags by half a sample. */
static void at_resonance_displacement_lags_force_by_90_degrees(void)
{
    struct resonator_cfg cfg = plain(500.0);
    double state[4] = {0};
    drive_at(5000.0, 0.5, 50000);
    run(&cfg, 0.0, 50000, state);
    struct phasor a = amplitude(0, 49000, 1000, 5000.0);
    double k = 2.0 * pi * 5000.0, half_sample = pi * 5000.0 / RATE_HZ;
    double expected = 0.5 * 1e6 * 500.0 / (k * k) * sin(half_sample) / half_sample;
    TEST_ASSERT_DOUBLE_WITHIN(1e-4 * expected, expected, hypot(a.i, a.q));
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, -0.5 * pi - half_sample, atan2(a.q, a.i));
}

/* A2/A1 = (g W + 2 k z12) / (2 z k) when driven at sqrt(k^2 - W^2), real and with this sign. */
static void check_secondary(double rate_rad_s, double bias_rad_s, double gain)
{
    struct resonator_cfg cfg = plain(500.0);
    cfg.angular_gain = gain;
    cfg.bias_rad_s[0] = bias_rad_s;
    double k = 2.0 * pi * 5000.0;
    double freq = sqrt(k * k - rate_rad_s * rate_rad_s) / (2.0 * pi);
    double state[4] = {0};
    drive_at(freq, 0.5, 100000);
    run(&cfg, rate_rad_s, 100000, state);
    struct phasor a1 = amplitude(0, 90000, 10000, freq), a2 = amplitude(2, 90000, 10000, freq);
    double power = a1.i * a1.i + a1.q * a1.q;
    double real = (a2.i * a1.i + a2.q * a1.q) / power, imaginary = (a2.q * a1.i - a2.i * a1.q) / power;
    double expected = (gain * rate_rad_s + gain * bias_rad_s) / (k / 500.0);
    TEST_ASSERT_DOUBLE_WITHIN(1e-4 * fabs(expected), expected, real);
    TEST_ASSERT_DOUBLE_WITHIN(1e-4 * fabs(expected), 0.0, imaginary);
}

static void coriolis_response_has_its_size_and_sign(void)
{
    check_secondary(0.5, 0.0, 2.0);
    check_secondary(-0.5, 0.0, 2.0);
    check_secondary(0.5, 0.0, 1.6);
}

static void cross_damping_looks_like_a_positive_rate(void)
{
    check_secondary(0.0, 0.5, 2.0);
    check_secondary(0.0, -0.5, 1.6);
    check_secondary(0.3, 0.2, 2.0);
    check_secondary(0.3, -0.3 + 1e-3, 2.0);
}

/* Split D at 45 degrees: K12 = k D. A2/A1 = -K12 / (j w 2 z k) = j D / (2 z w) : 90 degrees off the rate's response. */
static void split_at_45_degrees_is_quadrature(void)
{
    struct resonator_cfg cfg = plain(500.0);
    cfg.split_hz = 0.05;
    cfg.split_axis_deg = 45.0;
    double state[4] = {0};
    drive_at(5000.0, 0.5, 100000);
    run(&cfg, 0.0, 100000, state);
    struct phasor a1 = amplitude(0, 99000, 1000, 5000.0), a2 = amplitude(2, 99000, 1000, 5000.0);
    double power = a1.i * a1.i + a1.q * a1.q, expected = 0.05 / 5000.0 * 500.0;
    TEST_ASSERT_DOUBLE_WITHIN(1e-4 * expected, expected, (a2.q * a1.i - a2.i * a1.q) / power);
    TEST_ASSERT_DOUBLE_WITHIN(1e-4 * expected, 0.0, (a2.i * a1.i + a2.q * a1.q) / power);
}

/* quadrature_rad_s is a rate: its force on mode 2 is as large as that of a rate of the same figure. */
static void quadrature_parameter_equals_a_rate(void)
{
    struct resonator_cfg cfg = plain(500.0);
    cfg.quadrature_rad_s = 0.1;
    struct resonator_coefs c = coefs_of(&cfg, 25.0, 0.0);
    double k = 2.0 * pi * 5000.0;
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 2.0 * k * 0.1, c.cross_stiffness);
}

/* The principal axes of the split stiffness: frequencies f +- split/2 whatever the angle. */
static void split_has_its_size_at_every_angle(void)
{
    double k = 2.0 * pi * 5000.0;
    for (double angle = -90.0; angle <= 90.0; angle += 7.5) {
        struct resonator_cfg cfg = plain(1e4);
        cfg.split_hz = 0.02;
        cfg.split_axis_deg = angle;
        struct resonator_coefs c = coefs_of(&cfg, 25.0, 0.0);
        double mean = 0.5 * (c.stiffness[0] + c.stiffness[1]), half = 0.5 * (c.stiffness[0] - c.stiffness[1]);
        double radius = hypot(half, c.cross_stiffness);
        TEST_ASSERT_DOUBLE_WITHIN(1e-3, k * k, mean);
        TEST_ASSERT_DOUBLE_WITHIN(1e-6, 0.02, (sqrt(mean + radius) - sqrt(mean - radius)) / (2.0 * pi));
        TEST_ASSERT_DOUBLE_WITHIN(1e-3, radius * cos(angle * pi / 90.0), half);
        TEST_ASSERT_DOUBLE_WITHIN(1e-3, radius * sin(angle * pi / 90.0), c.cross_stiffness);
    }
}

static void temperature_laws(void)
{
    struct resonator_cfg cfg = plain(7.3e5);
    cfg.frequency_slope_ppm_per_degc = 85.0;
    cfg.frequency_curvature_ppm_per_degc2 = 0.02;
    cfg.quality_slope_per_degc = 0.002;
    cfg.quality_knee_degc = 60.0;
    cfg.quality_slope_above_per_degc = -0.002;
    const double bias[6] = {1e-3, -4e-5, 7e-7, -5e-9, 3e-11, -2e-13};
    memcpy(cfg.bias_rad_s, bias, sizeof bias);
    for (double degc = -60.0; degc <= 110.0; degc += 10.0) {
        double t = degc - 25.0, k = 2.0 * pi * 5000.0 * (1.0 + 85e-6 * t + 0.02e-6 * t * t);
        double q = 7.3e5 * (degc <= 60.0 ? 1.0 + 0.002 * t : 1.07 - 0.002 * (degc - 60.0));
        double b = 0.0;
        for (int i = 0; i < 6; i++) {
            b += bias[i] * pow(t, i);
        }
        struct resonator_coefs c = coefs_of(&cfg, degc, 0.0);
        TEST_ASSERT_DOUBLE_WITHIN(1e-14 * k * k, k * k, c.stiffness[0]);
        TEST_ASSERT_DOUBLE_WITHIN(1e-13 * k / q, k / q, c.damping[1]);
        TEST_ASSERT_DOUBLE_WITHIN(1e-14, 2.0 * b, c.cross_damping_12);
        TEST_ASSERT_EQUAL_DOUBLE(c.cross_damping_12, c.cross_damping_21);
    }
}

static void decay_mismatch_divides_the_damping(void)
{
    struct resonator_cfg cfg = plain(1e4);
    cfg.decay_mismatch = 0.01;
    cfg.decay_axis_deg = 30.0;
    struct resonator_coefs c = coefs_of(&cfg, 25.0, 0.0);
    double k_over_q = 2.0 * pi * 0.5;
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, k_over_q * 1.0025, c.damping[0]);
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, k_over_q * 0.9975, c.damping[1]);
    TEST_ASSERT_EQUAL_DOUBLE(0.0, c.cross_damping_12);
}

static void every_coupling(struct resonator_coefs *c)
{
    struct resonator_cfg cfg = plain(200.0);
    cfg.split_hz = 1.0;
    cfg.split_axis_deg = 20.0;
    cfg.bias_rad_s[0] = 0.5;
    *c = coefs_of(&cfg, 25.0, 3.5);
    c->rate_dot_rad_s2 = 200.0;
}

/* Two half intervals are one whole one, and back again is where it began, with force. */
static void maps_compose(void)
{
    const double k = 2.0 * pi * 5000.0, period = 2e-5;
    struct resonator_coefs coefs;
    struct resonator_map whole, half, back;
    const pair force = {0.7, -0.4};
    every_coupling(&coefs);
    resonator_map_over(&coefs, k, period, &whole);
    resonator_map_over(&coefs, k, 0.5 * period, &half);
    resonator_map_over(&coefs, k, -period, &back);
    struct resonator_state start = {{{0.3, -0.2}, {0.1, 0.5}}}, once = start, twice = start;
    pair pushed[2];
    resonator_push(&whole, force, pushed);
    resonator_step(&whole, &once, pushed);
    resonator_push(&half, force, pushed);
    resonator_step(&half, &twice, pushed);
    resonator_step(&half, &twice, pushed);
    struct resonator_state returned = once;
    resonator_push(&back, force, pushed);
    resonator_step(&back, &returned, pushed);
    for (int i = 0; i < 4; i++) {
        TEST_ASSERT_DOUBLE_WITHIN(5e-15, once.mode[i / 2][i % 2], twice.mode[i / 2][i % 2]);
        TEST_ASSERT_DOUBLE_WITHIN(5e-15, start.mode[i / 2][i % 2], returned.mode[i / 2][i % 2]);
    }
}

/* Driven at the frequency that resonator_quadrature_rad_s gives, the primary lags by 90 degrees with every coupling on. */
static void quadrature_frequency_holds_with_couplings(void)
{
    struct resonator_cfg cfg = plain(500.0);
    cfg.split_hz = 3.0;
    cfg.split_axis_deg = 20.0;
    cfg.bias_rad_s[0] = 0.5;
    struct resonator_coefs coefs = coefs_of(&cfg, 25.0, 3.5);
    double freq = resonator_quadrature_rad_s(&coefs) / (2.0 * pi);
    double state[4] = {0};
    drive_at(freq, 0.5, 200000);
    run(&cfg, 3.5, 200000, state);
    struct phasor a = amplitude(0, 100000, 100000, freq);
    TEST_ASSERT_TRUE(fabs(freq - sqrt(coefs.stiffness[0]) / (2.0 * pi)) > 0.05); /* or else nothing is tested */
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, -0.5 * pi - pi * freq / RATE_HZ, atan2(a.q, a.i));
}

static void impossible_devices_are_refused(void)
{
    double state[4] = {0};
    struct resonator_cfg cfg = plain(1e4);
    cfg.bias_rad_s[0] = 1.6; /* g bias > k / Q = 3.14: the mode would feed itself */
    TEST_ASSERT_EQUAL_INT32(TWIN_ERROR_RESONATOR, plant_run(&cfg, RATE_HZ, 1, 0, NULL, NULL, NULL, NULL, state, NULL));
    cfg.bias_rad_s[0] = 1.5;
    TEST_ASSERT_EQUAL_INT32(TWIN_OK, plant_run(&cfg, RATE_HZ, 1, 0, NULL, NULL, NULL, NULL, state, NULL));
    cfg.quality_factor = -1.0;
    TEST_ASSERT_EQUAL_INT32(TWIN_ERROR_RESONATOR, plant_run(&cfg, RATE_HZ, 1, 0, NULL, NULL, NULL, NULL, state, NULL));
    cfg = plain(1e4);
    cfg.frequency_hz = NAN;
    TEST_ASSERT_NOT_EQUAL(TWIN_OK, plant_run(&cfg, RATE_HZ, 1, 0, NULL, NULL, NULL, NULL, state, NULL));
    cfg = plain(1e4);
    TEST_ASSERT_EQUAL_INT32(TWIN_ERROR_SAMPLE_RATE, plant_run(&cfg, 15000.0, 1, 0, NULL, NULL, NULL, NULL, state, NULL));
    TEST_ASSERT_EQUAL_INT32(TWIN_ERROR_SAMPLE_RATE, plant_run(&cfg, RATE_HZ, 0, 0, NULL, NULL, NULL, NULL, state, NULL));
    double rate = NAN;
    TEST_ASSERT_EQUAL_INT32(TWIN_ERROR_PROFILE, plant_run(&cfg, RATE_HZ, 1, 1, NULL, &rate, NULL, NULL, state, NULL));
    cfg.quality_slope_per_degc = -0.002;
    double hot = 600.0; /* Q would be negative */
    TEST_ASSERT_EQUAL_INT32(TWIN_ERROR_PROFILE, plant_run(&cfg, RATE_HZ, 1, 1, &hot, NULL, NULL, NULL, state, NULL));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(free_decay_is_the_closed_form);
    RUN_TEST(held_force_ends_in_the_static_deflection);
    RUN_TEST(at_resonance_displacement_lags_force_by_90_degrees);
    RUN_TEST(coriolis_response_has_its_size_and_sign);
    RUN_TEST(cross_damping_looks_like_a_positive_rate);
    RUN_TEST(split_at_45_degrees_is_quadrature);
    RUN_TEST(quadrature_parameter_equals_a_rate);
    RUN_TEST(split_has_its_size_at_every_angle);
    RUN_TEST(temperature_laws);
    RUN_TEST(decay_mismatch_divides_the_damping);
    RUN_TEST(maps_compose);
    RUN_TEST(quadrature_frequency_holds_with_couplings);
    RUN_TEST(impossible_devices_are_refused);
    return UNITY_END();
}

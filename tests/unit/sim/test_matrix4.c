/* Matrix exponential and phi1 against closed forms. */
#include <math.h>

#include "sim/matrix4.h"
#include "unity.h"

void setUp(void) {}
void tearDown(void) {}

static struct matrix4 zero(void)
{
    return (struct matrix4){0};
}

static double norm_of_difference(const struct matrix4 *a, double expected[4][4])
{
    double worst = 0.0;
    for (int row = 0; row < 4; row++) {
        for (int column = 0; column < 4; column++) {
            worst = fmax(worst, fabs(matrix4_get(a, row, column) - expected[row][column]));
        }
    }
    return worst;
}

/* Diagonal: e^a and (e^a - 1)/a one by one, over twenty orders of size. */
static void diagonal_matrices(void)
{
    for (double size = 1e-12; size < 300.0; size *= 3.0) {
        struct matrix4 a = zero(), exponential, phi1;
        const double values[4] = {-size, -0.3 * size, 1e-3 * size, 0.0};
        for (int i = 0; i < 4; i++) {
            matrix4_set(&a, i, i, values[i]);
        }
        matrix4_exponential(&a, &exponential, &phi1);
        for (int i = 0; i < 4; i++) {
            double phi = values[i] == 0.0 ? 1.0 : expm1(values[i]) / values[i];
            TEST_ASSERT_DOUBLE_WITHIN(3e-14, exp(values[i]), matrix4_get(&exponential, i, i));
            TEST_ASSERT_DOUBLE_WITHIN(3e-14, phi, matrix4_get(&phi1, i, i));
        }
    }
}

/* Two rotations by different angles: cosines, sines, and their integrals. */
static void rotations(void)
{
    for (double angle = 0.01; angle < 40.0; angle *= 1.9) {
        const double w[2] = {angle, -0.37 * angle};
        struct matrix4 a = zero(), exponential, phi1;
        double rotated[4][4] = {{0}}, integrated[4][4] = {{0}};
        for (int i = 0; i < 2; i++) {
            matrix4_set(&a, 2 * i, 2 * i + 1, -w[i]);
            matrix4_set(&a, 2 * i + 1, 2 * i, w[i]);
            rotated[2 * i][2 * i] = rotated[2 * i + 1][2 * i + 1] = cos(w[i]);
            rotated[2 * i + 1][2 * i] = sin(w[i]);
            rotated[2 * i][2 * i + 1] = -sin(w[i]);
            integrated[2 * i][2 * i] = integrated[2 * i + 1][2 * i + 1] = sin(w[i]) / w[i];
            integrated[2 * i + 1][2 * i] = 2.0 * pow(sin(0.5 * w[i]), 2.0) / w[i];
            integrated[2 * i][2 * i + 1] = -integrated[2 * i + 1][2 * i];
        }
        matrix4_exponential(&a, &exponential, &phi1);
        TEST_ASSERT_LESS_THAN_DOUBLE(1e-14 * (1.0 + angle), norm_of_difference(&exponential, rotated));
        TEST_ASSERT_LESS_THAN_DOUBLE(1e-14 * (1.0 + angle), norm_of_difference(&phi1, integrated));
    }
}

/* A shift: e^a = 1 + a + a^2/2 + a^3/6 ends by itself. Rows and columns must not be exchanged. */
static void nilpotent_matrix(void)
{
    struct matrix4 a = zero(), exponential, phi1;
    for (int i = 0; i < 3; i++) {
        matrix4_set(&a, i, i + 1, 2.0);
    }
    matrix4_exponential(&a, &exponential, &phi1);
    double e[4][4] = {{1, 2, 2, 4.0 / 3}, {0, 1, 2, 2}, {0, 0, 1, 2}, {0, 0, 0, 1}};
    double p[4][4] = {{1, 1, 2.0 / 3, 1.0 / 3}, {0, 1, 1, 2.0 / 3}, {0, 0, 1, 1}, {0, 0, 0, 1}};
    TEST_ASSERT_LESS_THAN_DOUBLE(1e-15, norm_of_difference(&exponential, e));
    TEST_ASSERT_LESS_THAN_DOUBLE(1e-15, norm_of_difference(&phi1, p));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(diagonal_matrices);
    RUN_TEST(rotations);
    RUN_TEST(nilpotent_matrix);
    return UNITY_END();
}

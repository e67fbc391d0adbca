#include "exam/shell.h"

/* Series of phi(Z) = (e^Z - 1)/Z: |Z| = w h < 2.6 over the permitted carriers (0.4 of the sample rate): rest below 2.6^27/28! = 5e-19;
 * at the usual tenth of the sample rate the terms vanish long before. */
enum { TERMS = 26, TERMS_USUAL = 14 };

/* Rows 1 and 3 of the matrix of motion times a time; rows 0 and 2 are x' = w (x'/w). */
struct motion {
    double turn; /* w h */
    double row[2][4];
};

static struct motion motion_of(const struct exam_shell *s, double w, double h)
{
    double centrifugal = s->rate_rad_s * s->rate_rad_s;
    double coriolis = s->angular_gain * s->rate_rad_s;
    double euler = 0.5 * s->angular_gain * s->rate_slope_rad_s2;
    double by_place = -h / w;
    return (struct motion){w * h,
                           {{by_place * (s->stiffness[0][0] - centrifugal), -h * s->damping[0][0], by_place * (s->stiffness[0][1] + euler),
                             -h * (s->damping[0][1] + coriolis)},
                            {by_place * (s->stiffness[1][0] - euler), -h * (s->damping[1][0] - coriolis),
                             by_place * (s->stiffness[1][1] - centrifugal), -h * s->damping[1][1]}}};
}

/* out = Z in + diagonal, two columns at a time; out may be in. */
static void horner(const struct motion *z, double in[4][4], double diagonal, double out[4][4])
{
    for (int c = 0; c < 4; c += 2) {
        exam_pair x1 = exam_pair_at(&in[0][c]), v1 = exam_pair_at(&in[1][c]), x2 = exam_pair_at(&in[2][c]), v2 = exam_pair_at(&in[3][c]);
        exam_pair rows[4] = {z->turn * v1, z->row[0][0] * x1 + z->row[0][1] * v1 + z->row[0][2] * x2 + z->row[0][3] * v2,
                             z->turn * v2, z->row[1][0] * x1 + z->row[1][1] * v1 + z->row[1][2] * x2 + z->row[1][3] * v2};
        for (int row = 0; row < 4; row++) {
            memcpy(&out[row][c], &rows[row], sizeof rows[row]);
        }
    }
    for (int i = 0; i < 4; i++) {
        out[i][i] += diagonal;
    }
}

static void phi_of(const struct motion *z, double phi[4][4])
{
    int terms = z->turn < 0.8 ? TERMS_USUAL : TERMS;
    double coefficient[TERMS + 1] = {1.0}; /* 1/(k+1)! */
    for (int k = 1; k <= terms; k++) {
        coefficient[k] = coefficient[k - 1] / (k + 1);
    }
    memset(phi, 0, 4 * sizeof *phi);
    for (int k = terms; k >= 0; k--) {
        horner(z, phi, coefficient[k], phi);
    }
}

/* A force that acts over the last `h` of the period: phi h B, B = (0, f1/w, 0, f2/w). */
static void response(double phi[4][4], double h, double w, const struct exam_shell *s, int channel, double out[4])
{
    for (int row = 0; row < 4; row++) {
        out[row] = h / w * (phi[row][1] * s->force[0][channel] + phi[row][3] * s->force[1][channel]);
    }
}

static void delayed(const struct exam_shell *s, double w, double h, int channel, struct exam_step *step)
{
    double left = h - s->force_delay_s[channel];
    struct motion z = motion_of(s, w, left);
    double phi[4][4];
    phi_of(&z, phi);
    double whole[4];
    memcpy(whole, step->now[channel], sizeof whole);
    response(phi, left, w, s, channel, step->now[channel]);
    for (int row = 0; row < 4; row++) {
        step->before[channel][row] = whole[row] - step->now[channel][row];
    }
}

void exam_step_make(const struct exam_shell *shell, double carrier_rad_s, double period_s, struct exam_step *step)
{
    struct motion z = motion_of(shell, carrier_rad_s, period_s);
    double phi[4][4], transition[4][4];
    phi_of(&z, phi);
    horner(&z, phi, 1.0, transition);
    memset(step->before, 0, sizeof step->before);
    for (int row = 0; row < 4; row++) {
        for (int c = 0; c < 4; c++) {
            step->transition[c][row] = transition[row][c];
        }
    }
    for (int channel = 0; channel < 2; channel++) {
        response(phi, period_s, carrier_rad_s, shell, channel, step->now[channel]);
        if (shell->force_delay_s[channel] > 0.0) {
            delayed(shell, carrier_rad_s, period_s, channel, step);
        }
    }
}

void exam_step_walk(const struct exam_step *a, const struct exam_step *b, double count, struct exam_step *first, struct exam_step *stride)
{
    const double *from = (const double *)a, *to = (const double *)b;
    double *start = (double *)first, *by = (double *)stride;
    for (int i = 0; i < EXAM_STEP_NUMBERS; i++) {
        by[i] = (to[i] - from[i]) / count;
        start[i] = from[i] + 0.5 * by[i];
    }
}

/* Andrews' mechanism, (u, lambda) form, optimal scaling, trapezoidal rule, in
 * plain C: what a person would write by hand for this one problem.  The kernel
 * of the package is measured against it; see kernel.py, which compiles it,
 * passes the data and checks that both take the same steps.
 *
 * Coordinates: E, F, G, H (8).  Bars: 7, ends 0..3 = E..H, -1 = fixed. */
#include <math.h>
#include <string.h>

enum { N = 8, M = 7, S = N + M };

static int solve(double a[S][S], double b[S])
{
    for (int k = 0; k < S; k++) {
        int p = k;
        double largest = fabs(a[k][k]);
        for (int i = k + 1; i < S; i++)
            if (fabs(a[i][k]) > largest) {
                largest = fabs(a[i][k]);
                p = i;
            }
        if (!(largest > 0))
            return 0;
        if (p != k) {
            for (int j = k; j < S; j++) {
                double x = a[k][j];
                a[k][j] = a[p][j];
                a[p][j] = x;
            }
            double x = b[k];
            b[k] = b[p];
            b[p] = x;
        }
        double r = 1 / a[k][k];
        for (int i = k + 1; i < S; i++) {
            double f = a[i][k];
            if (f != 0) {
                f *= r;
                for (int j = k + 1; j < S; j++)
                    a[i][j] -= f * a[k][j];
                b[i] -= f * b[k];
            }
        }
    }
    for (int k = S - 1; k >= 0; k--) {
        double x = b[k];
        for (int j = k + 1; j < S; j++)
            x -= a[k][j] * b[j];
        b[k] = x / a[k][k];
    }
    return 1;
}

/* mass: 8x8; ends: 7x2; anchors: 7x2, fixed end of bar k; lengths: 7;
 * spring: C, D = fixed part + (z) E with complex z, stiffness, rest length: 8;
 * state: u, v, a, lambda (31), overwritten.  Returns corrections computed. */
long march(const double mass[N][N], const int ends[M][2], const double anchors[M][2],
           const double lengths[M], const double spring[8], double torque, double h, long steps,
           int cap, double settled_below, double state[N * 3 + M], double *norms)
{
    const double beta = 0.25, gamma = 0.5;
    const double left = beta * h * h, right = 1 / (beta * h * h);
    double *un = state, *vn = state + N, *an = state + 2 * N, *lambda = state + 3 * N;
    double constant[S][S] = {{0}}, a[S][S], b[S];
    long solves_in_all = 0;
    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++)
            constant[i][j] = left * right * mass[i][j];

    for (long s = 0; s < steps; s++) {
        double u[N], j_n[N];
        for (int i = 0; i < N; i++)
            u[i] = un[i] + h * vn[i];
        for (int i = 0; i < N; i++) {
            j_n[i] = 0;
            for (int j = 0; j < N; j++)
                j_n[i] += mass[i][j] * (un[j] / (beta * h * h) + vn[j] / (beta * h)
                                        + (1 / (2 * beta) - 1) * an[j]);
        }
        double previous = INFINITY;
        int settled = 0; /* corrections in a row in the terminal phase */
        for (int solves = 0; solves < cap; solves++) {
            memcpy(a, constant, sizeof a);
            for (int i = 0; i < N; i++) {
                double x = j_n[i];
                for (int j = 0; j < N; j++)
                    x -= mass[i][j] * u[j] * right;
                b[i] = x;
            }
            /* bars */
            for (int k = 0; k < M; k++) {
                int i = ends[k][0], j = ends[k][1];
                double dx = u[2 * j], dy = u[2 * j + 1];
                if (i >= 0) {
                    dx -= u[2 * i];
                    dy -= u[2 * i + 1];
                } else {
                    dx -= anchors[k][0];
                    dy -= anchors[k][1];
                }
                double l = lambda[k];
                b[N + k] = -(dx * dx + dy * dy - lengths[k] * lengths[k]) / 2;
                b[2 * j] += l * dx;
                b[2 * j + 1] += l * dy;
                a[2 * j][2 * j] -= left * l;
                a[2 * j + 1][2 * j + 1] -= left * l;
                a[2 * j][N + k] -= dx;
                a[2 * j + 1][N + k] -= dy;
                a[N + k][2 * j] += dx;
                a[N + k][2 * j + 1] += dy;
                if (i >= 0) {
                    b[2 * i] -= l * dx;
                    b[2 * i + 1] -= l * dy;
                    a[2 * i][2 * i] -= left * l;
                    a[2 * i + 1][2 * i + 1] -= left * l;
                    a[2 * i][2 * j] += left * l;
                    a[2 * i + 1][2 * j + 1] += left * l;
                    a[2 * j][2 * i] += left * l;
                    a[2 * j + 1][2 * i + 1] += left * l;
                    a[2 * i][N + k] += dx;
                    a[2 * i + 1][N + k] += dy;
                    a[N + k][2 * i] -= dx;
                    a[N + k][2 * i + 1] -= dy;
                }
            }
            /* spring C-D, D = d0 + z E */
            double zx = spring[4], zy = spring[5], c = spring[6], l0 = spring[7];
            double dx = spring[2] + zx * u[0] - zy * u[1] - spring[0];
            double dy = spring[3] + zy * u[0] + zx * u[1] - spring[1];
            double square = dx * dx + dy * dy, length = sqrt(square);
            double q = c * (1 - l0 / length), r = c * l0 / (length * square);
            b[0] -= q * (zx * dx + zy * dy);
            b[1] -= q * (zx * dy - zy * dx);
            double txx = -q - r * dx * dx, txy = -r * dx * dy, tyy = -q - r * dy * dy;
            double sxx = zx * txx + zy * txy, sxy = zx * txy + zy * tyy;
            double syx = zx * txy - zy * txx, syy = zx * tyy - zy * txy;
            a[0][0] -= left * (sxx * zx + sxy * zy);
            a[0][1] -= left * (sxy * zx - sxx * zy);
            a[1][0] -= left * (syx * zx + syy * zy);
            a[1][1] -= left * (syy * zx - syx * zy);
            /* torque on F */
            double x = u[2], y = u[3], f2 = x * x + y * y, t = torque / f2;
            b[2] -= t * y;
            b[3] += t * x;
            a[2][2] -= left * 2 * t * x * y / f2;
            a[2][3] -= left * t * (y * y - x * x) / f2;
            a[3][2] -= left * t * (y * y - x * x) / f2;
            a[3][3] += left * 2 * t * x * y / f2;

            for (int i = 0; i < N; i++)
                b[i] *= left;
            if (!solve(a, b))
                return -1;
            solves_in_all++;
            double us = 0, ls = 0, size = 0;
            for (int i = 0; i < N; i++)
                us += b[i] * b[i];
            for (int i = 0; i < M; i++)
                ls += b[N + i] * b[N + i];
            double norm = sqrt(us + ls);
            if (!isfinite(norm))
                return -1;
            if (settled >= 2 && norm >= previous)
                break;
            previous = norm;
            norms[2 * s] = sqrt(us);
            norms[2 * s + 1] = sqrt(ls);
            for (int i = 0; i < N; i++) {
                u[i] += b[i];
                size += u[i] * u[i];
            }
            for (int i = 0; i < M; i++)
                lambda[i] += right * b[N + i];
            settled = us < settled_below * settled_below * size ? settled + 1 : 0;
            if (norm == 0)
                break;
        }
        for (int i = 0; i < N; i++) {
            double d = u[i] - un[i];
            double v = gamma / (beta * h) * d + (1 - gamma / beta) * vn[i]
                       + h * (1 - gamma / (2 * beta)) * an[i];
            double acc = d / (beta * h * h) - vn[i] / (beta * h) - (1 / (2 * beta) - 1) * an[i];
            un[i] = u[i];
            vn[i] = v;
            an[i] = acc;
        }
    }
    return solves_in_all;
}

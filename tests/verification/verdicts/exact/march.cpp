// The schemes of the Newmark family, and the exact motion, in numbers of 33 digits.
//
// Reads one problem from a file (see ../exact.py) and prints JSON: the state of the exact
// motion at the end, and for each integrator and step size the truncation errors of u, v
// and λ there, the invariants along the way, and states to take Jacobians at.  With 33
// digits rounding plays no part in any of them.
//
//     march PROBLEM T_END INTEGRATOR:H ...      or
//     march PROBLEM matrices                    X, Y, G, f + Gλ at states from standard input
//
// Built for small systems: everything is dense.  Newton's matrix is formed and factorised
// in double precision, by differences; residuals are in quadruple precision, so that each
// iteration adds some ten digits.
#include <quadmath.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iostream>
#include <sstream>
#include <string>
#include <vector>

typedef __float128 quad;
using std::string;
using std::vector;

static inline double sin_(double x) { return std::sin(x); }
static inline double cos_(double x) { return std::cos(x); }
static inline double sqrt_(double x) { return std::sqrt(x); }
static inline quad sin_(quad x) { return sinq(x); }
static inline quad cos_(quad x) { return cosq(x); }
static inline quad sqrt_(quad x) { return sqrtq(x); }
static inline double abs_(double x) { return std::fabs(x); }
static inline quad abs_(quad x) { return fabsq(x); }

static quad parsed(const string &text) { return strtoflt128(text.c_str(), nullptr); }

static const quad GRAVITY = parsed("9.81"), FIFTH = parsed("0.2"), TENTH = parsed("0.1"),
                  HALF_MASS = parsed("0.0005");

// A law of time: value + rate t + acceleration t²/2 + amplitude sin(frequency t + phase).
struct Law {
    quad p[6];
    template <class T> T at(T t, int derivative) const {
        T r = T(p[1]), s = T(p[2]), a = T(p[3]), w = T(p[4]), phase = w * t + T(p[5]);
        if (derivative == 0) return T(p[0]) + r * t + s * t * t / 2 + a * sin_(phase);
        if (derivative == 1) return r + s * t + a * w * cos_(phase);
        return s - a * w * w * sin_(phase);
    }
};

// Acts on Δ = Δ0 + Σ (a_k + b_k R) P_k.
struct Element {
    string kind;
    vector<int> at;
    vector<quad> a, b, p;
    quad offset[2];
    Law law;
    template <class T> void vector_of(const T *u, bool whole, T d[2]) const {
        d[0] = whole ? T(offset[0]) : T(0);
        d[1] = whole ? T(offset[1]) : T(0);
        for (size_t k = 0; k < at.size(); k++) {
            const T *P = u + at[k];
            d[0] += T(a[k]) * P[0] - T(b[k]) * P[1];
            d[1] += T(b[k]) * P[0] + T(a[k]) * P[1];
        }
    }
    template <class T> void load(const T F[2], T *to) const {
        for (size_t k = 0; k < at.size(); k++) {
            to[at[k]] += T(a[k]) * F[0] + T(b[k]) * F[1];
            to[at[k] + 1] += T(a[k]) * F[1] - T(b[k]) * F[0];
        }
    }
};

struct Problem {
    int n, m;
    string special;  // a problem that is no planar mechanism
    vector<quad> M, u0, v0;
    vector<Element> constraints, forces;

    // f(u, v, t)
    template <class T> void force(T t, const T *u, const T *v, T *f) const {
        for (int i = 0; i < n; i++) f[i] = 0;
        for (const Element &e : forces) {
            T d[2], w[2], F[2] = {0, 0};
            if (e.kind == "load") {
                f[e.at[0]] += T(e.p[0]);
                f[e.at[0] + 1] += T(e.p[1]);
                continue;
            }
            e.vector_of(u, true, d);
            T square = d[0] * d[0] + d[1] * d[1], length = sqrt_(square);
            if (e.kind == "spring") {
                T s = -T(e.p[0]) * (1 - T(e.p[1]) / length);
                F[0] = s * d[0], F[1] = s * d[1];
            } else if (e.kind == "damper") {
                e.vector_of(v, false, w);
                T s = -T(e.p[0]) * (d[0] * w[0] + d[1] * w[1]) / square;
                F[0] = s * d[0], F[1] = s * d[1];
            } else {  // torque
                F[0] = -T(e.p[0]) * d[1] / square, F[1] = T(e.p[0]) * d[0] / square;
            }
            e.load(F, f);
        }
        if (special == "shaken") f[1] = -T(GRAVITY);
        if (special == "bowl" || special == "floor") f[2] = -T(GRAVITY);
        if (special == "charged") {
            T drag = T(FIFTH) * sqrt_(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
            f[0] = 3 * v[1] - drag * v[0];
            f[1] = -3 * v[0] - drag * v[1];
            f[2] = -T(GRAVITY) - drag * v[2];
        }
        if (special == "car-axis") {
            T y = T(TENTH) * sin_(10 * t), x = sqrt_(1 - y * y), half = T(HALF_MASS);
            T left = sqrt_(u[0] * u[0] + u[1] * u[1]), p = u[2] - x, q = u[3] - y;
            T right = sqrt_(p * p + q * q), rest = T(0.5);
            f[0] = (rest - left) * u[0] / left;
            f[1] = (rest - left) * u[1] / left - half;
            f[2] = (rest - right) * p / right;
            f[3] = (rest - right) * q / right - half;
        }
    }

    // Φ(u, t) and G, (n, m) by rows
    template <class T> void constrain(T t, const T *u, T *phi, T *G) const {
        for (int i = 0; i < n * m; i++) G[i] = 0;
        vector<T> column(n);
        for (size_t r = 0; r < constraints.size(); r++) {
            const Element &e = constraints[r];
            T d[2], N[2];
            e.vector_of(u, true, d);
            if (e.kind == "distance") {
                phi[r] = (d[0] * d[0] + d[1] * d[1] - T(e.p[0])) / 2;
                N[0] = d[0], N[1] = d[1];
            } else if (e.kind == "line") {
                N[0] = T(e.p[0]), N[1] = T(e.p[1]);
                phi[r] = N[0] * d[0] + N[1] * d[1] - e.law.at(t, 0);
            } else {  // angle
                T angle = e.law.at(t, 0);
                N[0] = -sin_(angle), N[1] = cos_(angle);
                phi[r] = N[0] * d[0] + N[1] * d[1];
            }
            for (int i = 0; i < n; i++) column[i] = 0;
            e.load(N, column.data());
            for (int i = 0; i < n; i++) G[i * m + r] = column[i];
        }
        if (special == "shaken") {
            T y = u[1] - T(TENTH) * sin_(5 * t);
            phi[0] = (u[0] * u[0] + y * y - 1) / 2;
            G[0] = u[0], G[1] = y;
        } else if (special == "bowl") {
            phi[0] = u[2] - (u[0] * u[0] + 2 * u[1] * u[1]) / 2;
            G[0] = -u[0], G[1] = -2 * u[1], G[2] = 1;
        } else if (special == "floor") {
            T k = T(FIFTH);
            phi[0] = u[2] - k * sin_(3 * u[0]) * cos_(2 * u[1]);
            G[0] = -3 * k * cos_(3 * u[0]) * cos_(2 * u[1]);
            G[1] = 2 * k * sin_(3 * u[0]) * sin_(2 * u[1]);
            G[2] = 1;
        } else if (special == "charged") {
            phi[0] = (u[0] * u[0] + u[1] * u[1] + u[2] * u[2] - 1) / 2;
            for (int i = 0; i < 3; i++) G[i] = u[i];
        } else if (special == "car-axis") {
            T y = T(TENTH) * sin_(10 * t), x = sqrt_(1 - y * y);
            T p = u[0] - u[2], q = u[1] - u[3];
            phi[0] = u[0] * x + u[1] * y;
            phi[1] = p * p + q * q - 1;
            T given[8] = {x, 2 * p, y, 2 * q, 0, -2 * p, 0, -2 * q};
            for (int i = 0; i < 8; i++) G[i] = given[i];
        }
    }

    // Φ' = Gᵀ v + rate,  Φ'' = Gᵀ u'' + curvature
    template <class T> void derivatives(T t, const T *u, const T *v, T *rate, T *curvature) const {
        for (size_t r = 0; r < constraints.size(); r++) {
            const Element &e = constraints[r];
            T d[2], w[2];
            e.vector_of(u, true, d);
            e.vector_of(v, false, w);
            if (e.kind == "distance") {
                rate[r] = 0;
                curvature[r] = w[0] * w[0] + w[1] * w[1];
            } else if (e.kind == "line") {
                rate[r] = -e.law.at(t, 1);
                curvature[r] = -e.law.at(t, 2);
            } else {
                // d/dt of n(φ)·Δ with n' = −φ' e, e' = φ' n
                T angle = e.law.at(t, 0), w1 = e.law.at(t, 1), w2 = e.law.at(t, 2);
                T c = cos_(angle), s = sin_(angle);
                T along = c * d[0] + s * d[1], across = -s * d[0] + c * d[1];
                rate[r] = -w1 * along;
                curvature[r] = -w2 * along - w1 * w1 * across - 2 * w1 * (c * w[0] + s * w[1]);
            }
        }
        if (special == "shaken") {
            T k = T(TENTH), p = k * sin_(5 * t), p1 = 5 * k * cos_(5 * t), p2 = -25 * p;
            T y = u[1] - p, y1 = v[1] - p1;
            rate[0] = -y * p1;
            curvature[0] = v[0] * v[0] + y1 * y1 - y * p2;
        } else if (special == "bowl") {
            rate[0] = 0;
            curvature[0] = -v[0] * v[0] - 2 * v[1] * v[1];
        } else if (special == "floor") {
            T k = T(FIFTH), sx = sin_(3 * u[0]), cx = cos_(3 * u[0]);
            T sy = sin_(2 * u[1]), cy = cos_(2 * u[1]);
            rate[0] = 0;
            curvature[0] = k * (9 * sx * cy * v[0] * v[0] + 12 * cx * sy * v[0] * v[1] +
                                4 * sx * cy * v[1] * v[1]);
        } else if (special == "charged") {
            rate[0] = 0;
            curvature[0] = v[0] * v[0] + v[1] * v[1] + v[2] * v[2];
        } else if (special == "car-axis") {
            T y = T(TENTH) * sin_(10 * t), y1 = cos_(10 * t), y2 = -100 * y;
            T x = sqrt_(1 - y * y), x1 = -y * y1 / x;
            T x2 = -(y1 * y1 + y * y2) / x - y * y * y1 * y1 / (x * x * x);
            rate[0] = u[0] * x1 + u[1] * y1;
            curvature[0] = 2 * (v[0] * x1 + v[1] * y1) + u[0] * x2 + u[1] * y2;
            T p = v[0] - v[2], q = v[1] - v[3];
            rate[1] = 0;
            curvature[1] = 2 * (p * p + q * q);
        }
    }

    // Potential energy of springs and loads.
    quad potential(const quad *u) const {
        quad energy = 0;
        for (const Element &e : forces) {
            if (e.kind == "load")
                energy -= e.p[0] * u[e.at[0]] + e.p[1] * u[e.at[0] + 1];
            else if (e.kind == "spring") {
                quad d[2];
                e.vector_of(u, true, d);
                quad stretch = sqrtq(d[0] * d[0] + d[1] * d[1]) - e.p[1];
                energy += e.p[0] * stretch * stretch / 2;
            }
        }
        return energy;
    }
};

// LU with partial pivoting, rows scaled.
template <class T> struct LU {
    int n = 0;
    vector<T> A;
    vector<int> order;
    bool factorise(vector<T> given, int size) {
        n = size, A.swap(given), order.resize(n);
        vector<T> scale(n);
        for (int i = 0; i < n; i++) {
            order[i] = i, scale[i] = 0;
            for (int j = 0; j < n; j++)
                if (abs_(A[i * n + j]) > scale[i]) scale[i] = abs_(A[i * n + j]);
            if (!(scale[i] > 0)) return false;
        }
        for (int k = 0; k < n; k++) {
            int best = k;
            T most = -1;
            for (int i = k; i < n; i++) {
                T size = abs_(A[order[i] * n + k]) / scale[order[i]];
                if (size > most) most = size, best = i;
            }
            if (!(most > 0)) return false;
            std::swap(order[k], order[best]);
            T *row = &A[order[k] * n];
            for (int i = k + 1; i < n; i++) {
                T *other = &A[order[i] * n];
                if (other[k] == 0) continue;
                T factor = other[k] /= row[k];
                for (int j = k + 1; j < n; j++) other[j] -= factor * row[j];
            }
        }
        return true;
    }
    void solve(const T *b, T *x) const {
        for (int i = 0; i < n; i++) {
            T s = b[order[i]];
            for (int j = 0; j < i; j++) s -= A[order[i] * n + j] * x[j];
            x[i] = s;
        }
        for (int i = n - 1; i >= 0; i--) {
            T s = x[i];
            for (int j = i + 1; j < n; j++) s -= A[order[i] * n + j] * x[j];
            x[i] = s / A[order[i] * n + i];
        }
    }
};

typedef vector<quad> Q;

// Accelerations and multipliers of the index-1 system; false where it is singular.
static bool index1(const Problem &p, quad t, const quad *u, const quad *v, quad *a, quad *lambda) {
    int n = p.n, m = p.m, N = n + m;
    Q f(n), phi(m), G(n * m), rate(m), curvature(m), A(N * N, 0), b(N), x(N);
    p.force(t, u, v, f.data());
    p.constrain(t, u, phi.data(), G.data());
    p.derivatives(t, u, v, rate.data(), curvature.data());
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < n; j++) A[i * N + j] = p.M[i * n + j];
        for (int k = 0; k < m; k++) A[i * N + n + k] = -G[i * m + k], A[(n + k) * N + i] = G[i * m + k];
        b[i] = f[i];
    }
    for (int k = 0; k < m; k++) b[n + k] = -curvature[k];
    LU<quad> lu;
    if (!lu.factorise(A, N)) return false;
    lu.solve(b.data(), x.data());
    for (int i = 0; i < n; i++) a[i] = x[i];
    for (int k = 0; k < m; k++) lambda[k] = x[n + k];
    return true;
}

// Least change of x with Gᵀ x = misfit removed: x −= G (GᵀG)⁻¹ misfit.
static bool least_change(int n, int m, const Q &G, const Q &misfit, Q &x) {
    Q S(m * m, 0), y(m);
    for (int k = 0; k < m; k++)
        for (int l = 0; l < m; l++)
            for (int i = 0; i < n; i++) S[k * m + l] += G[i * m + k] * G[i * m + l];
    LU<quad> lu;
    if (!lu.factorise(S, m)) return false;
    lu.solve(misfit.data(), y.data());
    for (int i = 0; i < n; i++)
        for (int k = 0; k < m; k++) x[i] -= G[i * m + k] * y[k];
    return true;
}

// Brings a start that is consistent to 16 digits, or a guess, onto the constraints.
static bool make_consistent(Problem &p, bool velocities) {
    Q phi(p.m), G(p.n * p.m), rate(p.m), curvature(p.m), misfit(p.m);
    quad size = 0;
    for (quad x : p.u0) size = fmaxq(size, fabsq(x));
    for (int k = 0; k < 60; k++) {
        p.constrain(quad(0), p.u0.data(), phi.data(), G.data());
        quad worst = 0;
        for (quad x : phi) worst = fmaxq(worst, fabsq(x));
        if (worst < 1e-32Q * size) break;
        if (!least_change(p.n, p.m, G, phi, p.u0)) return false;
    }
    p.constrain(quad(0), p.u0.data(), phi.data(), G.data());
    p.derivatives(quad(0), p.u0.data(), p.v0.data(), rate.data(), curvature.data());
    for (int k = 0; k < p.m; k++) {
        misfit[k] = rate[k];
        for (int i = 0; i < p.n; i++) misfit[k] += G[i * p.m + k] * p.v0[i];
    }
    (void)velocities;  // given ones that fit change by their rounding only
    return least_change(p.n, p.m, G, misfit, p.v0);
}

// The exact motion: extrapolated midpoint rule (Gragg, Bulirsch, Stoer) on the index-1 system.
static bool exact(const Problem &p, quad t_end, quad tolerance, Q &u, Q &v, long &evaluations) {
    const int K = 9;
    int n = p.n, N = 2 * n;
    quad t = 0, H = t_end / 64;
    Q y(N), lambda(p.m);
    for (int i = 0; i < n; i++) y[i] = p.u0[i], y[n + i] = p.v0[i];
    auto rhs = [&](quad time, const Q &state, Q &out) {
        evaluations++;
        for (int i = 0; i < n; i++) out[i] = state[n + i];
        return index1(p, time, state.data(), state.data() + n, out.data() + n, lambda.data());
    };
    Q k0(N), z0(N), z1(N), z2(N), d(N);
    vector<Q> table(K, Q(N));
    long steps = 0;
    quad su = 0, sv = 0;
    while (t < t_end) {
        if (++steps > 20000 || H < t_end * 1e-9Q) return false;
        bool last = t + H >= t_end * (1 - 1e-30Q);
        if (last) H = t_end - t;
        if (!rhs(t, y, k0)) return false;
        quad error = 0;
        bool fine = true;
        for (int j = 0; j < K && fine; j++) {
            int count = 2 * (j + 1);
            quad h = H / count;
            z0 = y;
            for (int i = 0; i < N; i++) z1[i] = y[i] + h * k0[i];
            for (int s = 1; s < count && fine; s++) {
                fine = rhs(t + s * h, z1, d);
                for (int i = 0; i < N; i++) z2[i] = z0[i] + 2 * h * d[i];
                z0.swap(z1), z1.swap(z2);
            }
            fine = fine && rhs(t + H, z1, d);
            Q row(N);
            for (int i = 0; i < N; i++) row[i] = (z0[i] + z1[i] + h * d[i]) / 2;
            // Neville, in h²
            Q previous = table[0];
            table[0] = row;
            for (int l = 1; l <= j; l++) {
                quad ratio = quad(j + 1) / (j + 1 - l);
                Q next(N);
                for (int i = 0; i < N; i++)
                    next[i] = table[l - 1][i] + (table[l - 1][i] - previous[i]) / (ratio * ratio - 1);
                previous = table[l];
                table[l] = next;
            }
        }
        if (fine) {
            for (int i = 0; i < n; i++)
                su = fmaxq(su, fabsq(table[K - 1][i])), sv = fmaxq(sv, fabsq(table[K - 1][n + i]));
            for (int i = 0; i < N; i++) {
                quad e = fabsq(table[K - 1][i] - table[K - 2][i]) / ((i < n ? su : sv) + 1e-300Q);
                if (!(e <= error)) error = e;
            }
        }
        if (!fine || !(error <= tolerance)) {
            H *= 0.5Q;
            continue;
        }
        t = last ? t_end : t + H;
        y = table[K - 1];
        quad grow = error > 0 ? powq(tolerance / error, 1.0Q / (2 * K - 1)) * 0.8Q : 3;
        H *= fminq(fmaxq(grow, 0.3Q), 3);
    }
    u.assign(y.begin(), y.begin() + n);
    v.assign(y.begin() + n, y.end());
    return true;
}

static double largest(const Q &x) {
    double found = 0;
    for (quad e : x) found = std::fmax(found, (double)fabsq(e));
    return found;
}

static double relative(const Q &x, const Q &reference) {
    quad error = 0, size = 0;
    for (size_t i = 0; i < x.size(); i++) {
        error = fmaxq(error, fabsq(x[i] - reference[i]));
        size = fmaxq(size, fabsq(reference[i]));
    }
    return error == 0 ? 0 : size > 0 ? (double)(error / size) : INFINITY;
}

static void print(const char *name, const Q &x) {
    printf("\"%s\": [", name);
    for (size_t i = 0; i < x.size(); i++) printf("%s%.17g", i ? ", " : "", (double)x[i]);
    printf("]");
}

struct Scheme {
    string name;
    quad beta = 0.25Q, gamma = 0.5Q, am = 0, af = 0;
    int bdf = 0;
};

static Scheme scheme_of(const string &label) {
    Scheme s;
    s.name = label;
    std::stringstream in(label);
    string method, part;
    in >> method;
    vector<quad> values;
    while (in >> part) values.push_back(parsed(part.substr(part.find('=') + 1)));
    if (method == "newmark") {
        s.beta = values[0], s.gamma = values[1];
    } else if (method == "bdf1" || method == "bdf2") {
        s.bdf = method == "bdf1" ? 1 : 2;
    } else if (method == "hht") {
        s.af = values[0], s.beta = (1 + s.af) * (1 + s.af) / 4, s.gamma = 0.5Q + s.af;
    } else {
        quad r = values[0];
        s.am = (2 * r - 1) / (r + 1), s.af = r / (r + 1), s.gamma = 0.5Q + s.af - s.am;
        s.beta = (s.gamma + 0.5Q) * (s.gamma + 0.5Q) / 4;
    }
    return s;
}

// The whole run with one scheme and step size, printed as JSON.
static void march(const Problem &p, const Scheme &s, const string &h_text, quad t_end, int samples,
                  const Q *reference) {
    int n = p.n, m = p.m, N = n + m;
    quad h = parsed(h_text);
    long steps = (long)floorq(t_end / h + 1e-6Q);
    Q u = p.u0, v = p.v0, a(n), lambda(m), acc(n), uold(n), vold(n);
    index1(p, 0, u.data(), v.data(), a.data(), lambda.data());
    acc = a;
    for (int i = 0; i < n; i++) {
        uold[i] = u[i] - h * v[i] + h * h / 2 * a[i];
        vold[i] = v[i] - h * a[i];
    }
    // v = A1 u + c1, v' = A2 u + c2
    quad A1, A2;
    if (s.bdf == 1) A1 = 1 / h, A2 = 1 / (h * h);
    else if (s.bdf == 2) A1 = 3 / (2 * h), A2 = A1 * A1;
    else A1 = s.gamma / (s.beta * h), A2 = (1 - s.am) / (1 - s.af) / (s.beta * h * h);
    printf("{\"integrator\": \"%s\", \"h\": %s, \"steps\": %ld, ", s.name.c_str(), h_text.c_str(), steps);
    Q f(n), phi(m), G(n * m), c1(n), c2(n), un(n), vn(n), an(n), b(N);
    double worst[4] = {0, 0, 0, 0}, sizes[4] = {0, 0, 0, 0};
    quad kinetic0 = 0, potential0 = p.potential(u.data());
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) kinetic0 += v[i] * p.M[i * n + j] * v[j] / 2;
    string states;
    long iterations = 0, failed = 0;
    int taken = 0;
    bool ended = false;
    double coldest = 0;
    for (long step = 1; step <= steps && !ended; step++) {
        quad t = step * h;
        for (int i = 0; i < n; i++) {
            if (s.bdf == 1) {
                c1[i] = -u[i] / h;
                c2[i] = c1[i] / h - v[i] / h;
            } else if (s.bdf == 2) {
                c1[i] = -A1 * (4 * u[i] - uold[i]) / 3;
                c2[i] = A1 * (c1[i] - (4 * v[i] - vold[i]) / 3);
            } else {
                quad w = 1 / (s.beta * h * h);
                quad hat = u[i] + h * v[i] + (0.5Q - s.beta) * h * h * a[i];
                an[i] = -w * hat;  // a = w u + an
                c1[i] = v[i] + (1 - s.gamma) * h * a[i] + s.gamma * h * an[i];
                c2[i] = ((1 - s.am) * an[i] + s.am * a[i] - s.af * acc[i]) / (1 - s.af);
            }
            un[i] = u[i] + h * v[i];
        }
        Q before_u = u, before_v = v;
        u = un;
        double previous = INFINITY;
        int settled = 0, k = 0;
        LU<double> lu;
        for (k = 0; k < 60; k++) {
            for (int i = 0; i < n; i++) vn[i] = A1 * u[i] + c1[i];
            p.force(t, u.data(), vn.data(), f.data());
            p.constrain(t, u.data(), phi.data(), G.data());
            for (int i = 0; i < n; i++) {
                quad r = -f[i];
                for (int j = 0; j < n; j++) r += p.M[i * n + j] * (A2 * u[j] + c2[j]);
                for (int j = 0; j < m; j++) r -= G[i * m + j] * lambda[j];
                b[i] = -r / A2;
            }
            for (int j = 0; j < m; j++) b[n + j] = -phi[j];
            if (k < 6 || k % 6 == 0) {
                // [M + (A1/A2) Y + X/A2, −G; Gᵀ, 0] in (δu, δλ/A2), by differences in double
                vector<double> ud(n), vd(n), ld(m), J(N * N, 0.0), f0(n), f1(n), g0(n * m), g1(n * m), ph(m);
                double a1 = (double)A1, a2 = (double)A2, td = (double)t, size = 0, speed = 0;
                for (int i = 0; i < n; i++) {
                    ud[i] = (double)u[i], vd[i] = (double)vn[i];
                    size = std::fmax(size, std::fabs(ud[i]));
                    speed = std::fmax(speed, std::fabs(vd[i]));
                }
                for (int j = 0; j < m; j++) ld[j] = (double)lambda[j];
                auto total = [&](vector<double> &out) {
                    p.force(td, ud.data(), vd.data(), out.data());
                    p.constrain(td, ud.data(), ph.data(), g1.data());
                    for (int i = 0; i < n; i++)
                        for (int j = 0; j < m; j++) out[i] += g1[i * m + j] * ld[j];
                };
                double du = 1e-7 * size, dv = 1e-7 * std::fmax(speed, 1e-3 * size);
                for (int j = 0; j < n; j++) {
                    for (int half = 0; half < 2; half++) {
                        double *x = half ? &vd[j] : &ud[j], step_ = half ? dv : du, old = *x;
                        *x = old + step_, total(f1), *x = old - step_, total(f0), *x = old;
                        for (int i = 0; i < n; i++)
                            J[i * N + j] -= (f1[i] - f0[i]) / (2 * step_) / a2 * (half ? a1 : 1.0);
                    }
                }
                for (int i = 0; i < n; i++) {
                    for (int j = 0; j < n; j++) J[i * N + j] += (double)p.M[i * n + j];
                    for (int j = 0; j < m; j++)
                        J[i * N + n + j] = -(double)G[i * m + j], J[(n + j) * N + i] = (double)G[i * m + j];
                }
                if (!lu.factorise(J, N)) { ended = true; break; }
            }
            // The right-hand side may be far below what doubles resolve next to 1, not below 1e-300.
            vector<double> bd(N), x(N);
            for (int i = 0; i < N; i++) bd[i] = (double)b[i];
            lu.solve(bd.data(), x.data());
            double norm = 0, total_norm = 0;
            for (int i = 0; i < n; i++) u[i] += x[i], norm = std::fmax(norm, std::fabs(x[i]));
            for (int j = 0; j < m; j++) lambda[j] += quad(x[n + j]) * A2;
            for (int i = 0; i < N; i++) total_norm = std::hypot(total_norm, x[i]);
            double extent = largest(u);
            iterations++;
            if (!std::isfinite(total_norm) || extent > 1e100) { ended = true; break; }
            bool small = norm < 1e-20 * extent;
            if (small && total_norm >= 0.3 * previous) { settled = 1; break; }
            if (small && total_norm == 0) { settled = 1; break; }
            if (norm < 1e-29 * extent) { settled = 1; break; }
            previous = total_norm;
        }
        if (ended) break;
        if (!settled) failed++;
        for (int i = 0; i < n; i++) {
            vn[i] = A1 * u[i] + c1[i];
            quad now = A2 * u[i] + c2[i];
            if (!s.bdf) a[i] = u[i] / (s.beta * h * h) + an[i];
            acc[i] = now;
        }
        uold = before_u, vold = before_v, v = vn;
        // The same samples as the tool: evenly spread, the last among them.
        int parts = (int)std::min<long>(steps, samples);
        bool sampled = false;
        for (int q = taken + 1; q <= parts && !sampled; q++) {
            long at = lrint(std::nearbyint((double)steps * q / parts));
            if (at > step) break;
            if (at == step) sampled = true, taken = q;
        }
        if (sampled) {
            Q rate(m), curvature(m), a1(n), l1(m);
            p.constrain(t, u.data(), phi.data(), G.data());
            p.derivatives(t, u.data(), v.data(), rate.data(), curvature.data());
            bool regular = index1(p, t, u.data(), v.data(), a1.data(), l1.data());
            double uu = largest(u), vv = largest(v), velocity = 0, miss = 0, bound = vv;
            for (int j = 0; j < m; j++) {
                quad square = 0, r = rate[j];
                for (int i = 0; i < n; i++) square += G[i * m + j] * G[i * m + j], r += G[i * m + j] * v[i];
                velocity = std::fmax(velocity, (double)(fabsq(r) / sqrtq(square)));
                bound = std::fmax(bound, (double)(fabsq(rate[j]) / sqrtq(square)));
                worst[0] = std::fmax(worst[0], (double)(fabsq(phi[j]) / sqrtq(square)));
                if (regular) miss = std::fmax(miss, (double)fabsq(lambda[j] - l1[j]));
            }
            sizes[0] = std::fmax(sizes[0], uu);
            worst[1] = std::fmax(worst[1], velocity), sizes[1] = std::fmax(sizes[1], bound);
            if (regular) worst[2] = std::fmax(worst[2], miss), sizes[2] = std::fmax(sizes[2], largest(l1));
            quad kinetic = 0, potential = p.potential(u.data());
            for (int i = 0; i < n; i++)
                for (int j = 0; j < n; j++) kinetic += v[i] * p.M[i * n + j] * v[j] / 2;
            worst[3] = std::fmax(worst[3], (double)fabsq(kinetic - kinetic0 + potential - potential0));
            sizes[3] = std::fmax(sizes[3], (double)(kinetic + kinetic0 + fabsq(potential - potential0)));
            std::stringstream line;
            line.precision(17);
            line << (states.empty() ? "[" : ", [") << (double)t;
            for (quad x : u) line << ", " << (double)x;
            for (quad x : v) line << ", " << (double)x;
            for (quad x : lambda) line << ", " << (double)x;
            line << "]";
            states += line.str();
        }
        coldest = (double)t;
    }
    printf("\"completed\": %s, \"reached\": %.10g, \"unsettled\": %ld, \"iterations\": %ld, ",
           ended ? "false" : "true", coldest, failed, iterations);
    if (!ended && reference)
        printf("\"error\": {\"u\": %.10g, \"v\": %.10g, \"lambda\": %.10g}, ", relative(u, reference[0]),
               relative(v, reference[1]), relative(lambda, reference[2]));
    printf("\"invariant\": {");
    const char *names[4] = {"position", "velocity", "multiplier", "energy"};
    for (int i = 0; i < 4; i++)
        printf("%s\"%s\": %.10g", i ? ", " : "", names[i], worst[i] == 0 ? 0.0 : worst[i] / (sizes[i] > 0 ? sizes[i] : NAN));
    printf("}, ");
    print("u", u);
    printf(", ");
    print("v", v);
    printf(", ");
    print("lambda", lambda);
    printf(", \"states\": [%s]}", states.c_str());
}

static Problem read(const char *name) {
    std::ifstream file(name);
    Problem p;
    string line, word;
    while (std::getline(file, line)) {
        std::stringstream in(line);
        in >> word;
        vector<string> rest;
        string part;
        while (in >> part) rest.push_back(part);
        auto numbers = [&](size_t from) {
            vector<quad> found;
            for (size_t i = from; i < rest.size(); i++) found.push_back(parsed(rest[i]));
            return found;
        };
        if (word == "size") p.n = atoi(rest[0].c_str()), p.m = atoi(rest[1].c_str());
        else if (word == "special") p.special = rest[0];
        else if (word == "mass") p.M = numbers(0);
        else if (word == "u0") p.u0 = numbers(0);
        else if (word == "v0") p.v0 = numbers(0);
        else if (word == "constraint" || word == "force") {
            // kind K (place a b)*K offset_x offset_y parameters
            Element e;
            e.kind = rest[0];
            int K = atoi(rest[1].c_str());
            vector<quad> x = numbers(2);
            size_t i = 0;
            for (int k = 0; k < K; k++, i += 3)
                e.at.push_back((int)x[i]), e.a.push_back(x[i + 1]), e.b.push_back(x[i + 2]);
            e.offset[0] = x[i], e.offset[1] = x[i + 1];
            e.p.assign(x.begin() + i + 2, x.end());
            size_t law = e.kind == "line" ? 2 : 0;
            if (e.kind == "line" || e.kind == "angle")
                for (int k = 0; k < 6; k++) e.law.p[k] = e.p[law + k];
            (word == "force" ? p.forces : p.constraints).push_back(e);
        }
    }
    return p;
}

// X, Y, G and f + Gλ at states from standard input, one a line: t u v λ.
static int matrices(const Problem &p) {
    string line;
    int n = p.n, m = p.m;
    printf("[");
    for (long count = 0; std::getline(std::cin, line); count++) {
        std::stringstream in(line);
        string word;
        Q x;
        while (in >> word) x.push_back(parsed(word));
        quad t = x[0];
        Q u(x.begin() + 1, x.begin() + 1 + n), v(x.begin() + 1 + n, x.begin() + 1 + 2 * n);
        Q l(x.begin() + 1 + 2 * n, x.end()), X(n * n), Y(n * n), f0(n), f1(n), phi(m), G(n * m), g(n * m);
        auto total = [&](Q &out) {
            p.force(t, u.data(), v.data(), out.data());
            p.constrain(t, u.data(), phi.data(), g.data());
            for (int i = 0; i < n; i++)
                for (int j = 0; j < m; j++) out[i] += g[i * m + j] * l[j];
        };
        quad size = largest(u), speed = largest(v) + 1e-3 * largest(u);
        for (int half = 0; half < 2; half++) {
            for (int j = 0; j < n; j++) {
                quad *at = half ? &v[j] : &u[j], old = *at, d = 1e-11Q * (half ? speed : size);
                *at = old + d, total(f1), *at = old - d, total(f0), *at = old;
                for (int i = 0; i < n; i++) (half ? Y : X)[i * n + j] = -(f1[i] - f0[i]) / (2 * d);
            }
        }
        p.constrain(t, u.data(), phi.data(), G.data());
        total(f0);
        printf("%s\n{", count ? "," : "");
        print("X", X), printf(", "), print("Y", Y), printf(", "), print("G", G), printf(", ");
        print("F", f0), printf("}");
    }
    printf("]\n");
    return 0;
}

int main(int count, char **given) {
    Problem p = read(given[1]);
    if (count > 2 && !strcmp(given[2], "matrices")) return matrices(p);
    quad t_end = parsed(given[2]);
    if (!make_consistent(p, true)) return 1;
    Q fine[3], coarse[2], a(p.n);
    long evaluations = 0;
    bool known = exact(p, t_end, 1e-24Q, fine[0], fine[1], evaluations) &&
                 exact(p, t_end, 1e-21Q, coarse[0], coarse[1], evaluations);
    fine[2].resize(p.m);
    known = known && index1(p, t_end, fine[0].data(), fine[1].data(), a.data(), fine[2].data());
    printf("{");
    print("u0", p.u0);
    printf(", ");
    print("v0", p.v0);
    Q a0(p.n), l0(p.m);
    index1(p, 0, p.u0.data(), p.v0.data(), a0.data(), l0.data());
    printf(", ");
    print("lambda0", l0);
    if (known) {
        printf(", \"uncertainty\": [%.3g, %.3g], \"evaluations\": %ld, ", relative(coarse[0], fine[0]),
               relative(coarse[1], fine[1]), evaluations);
        print("u", fine[0]);
        printf(", ");
        print("v", fine[1]);
        printf(", ");
        print("lambda", fine[2]);
    }
    printf(", \"runs\": [");
    for (int i = 3; i < count; i++) {
        string text = given[i];
        size_t colon = text.rfind(':');
        printf("%s\n", i > 3 ? "," : "");
        march(p, scheme_of(text.substr(0, colon)), text.substr(colon + 1), t_end, 32, known ? fine : nullptr);
        fflush(stdout);
    }
    printf("]}\n");
}

/* The closed form of an S-R-S arm in plain C, one pose after the other: what a compiler makes of the formulas as written.
 * Same arithmetic as jaxik/closed_form.py, without statuses and limits. `real` is double or float. The geometry comes as
 * 69 numbers: shoulder S[3], C1t[9], delta_s, Ks[9] (elbow frame to shoulder frame), U, V, T, straight, delta_w,
 * J[9], Q[9] (tool to wrist), tool offset[3], pole[3], zero[3]; matrices by rows. */
#include <math.h>

#ifdef SINGLE
typedef float real;
#define ATAN2 atan2f
#define SQRT sqrtf
#define SIN sinf
#define COS cosf
#else
typedef double real;
#define ATAN2 atan2
#define SQRT sqrt
#define SIN sin
#define COS cos
#endif

static void product(const real *a, const real *b, real *c) {
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) c[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
}

static real half(real gap, real product) { return SQRT(gap > 0 ? gap / (4 * product) : 0); }

static void triple(const real *m, real *q) {
  real sine = SQRT(m[2] * m[2] + m[5] * m[5]), c = m[2] / sine, s = m[5] / sine;
  q[0] = ATAN2(m[5], m[2]);
  q[1] = ATAN2(sine, m[8]);
  q[2] = ATAN2(c * m[3] - s * m[0], c * m[4] - s * m[1]);
}

void solve(long n, const real *g, const real *position, const real *rotation, const real *swivel, real *out) {
  const real *S = g, *C1t = g + 3, *Ks = g + 13, *J = g + 27, *Q = g + 36, *offset = g + 45, *pole = g + 48, *zero = g + 51;
  const real delta_s = g[12], U = g[22], V = g[23], T = g[24], straight = g[25], delta_w = g[26], pi = (real)M_PI;
  for (long row = 0; row < n; row++) {
    real target[9], hand_tool[9], hand[9], w[3], frame[9], tframe[9], seen[9];
    for (int k = 0; k < 9; k++) target[k] = rotation[k * n + row];
    product(C1t, target, hand_tool);
    product(hand_tool, Q, hand);
    for (int i = 0; i < 3; i++) {
      w[i] = 0;
      for (int k = 0; k < 3; k++)
        w[i] += C1t[3 * i + k] * (position[k * n + row] - S[k]) - hand_tool[3 * i + k] * offset[k];
    }
    real d2 = w[0] * w[0] + w[1] * w[1] + w[2] * w[2], d = SQRT(d2);
    real sh = half((U + V) * (U + V) + T * T - d2, U * V), ch = half(d2 - (U - V) * (U - V) - T * T, U * V);
    real sin_a = 2 * sh * ch, cos_a = ch * ch - sh * sh, A = U + V * cos_a, B = V * sin_a, G = SQRT(B * B + T * T) + (real)1e-30;
    real l = SQRT(A * A + G * G), cb = A / l, sb = G / l, skewed = T / G;
    real nvec[3], m[3], mz = 0, mm = 0;
    for (int i = 0; i < 3; i++) {
      nvec[i] = w[i] / d;
      m[i] = nvec[i] - pole[i];
      mz += m[i] * zero[i];
      mm += m[i] * m[i];
    }
    real r[3], b[3], cp = COS(swivel[row]), sp = SIN(swivel[row]);
    for (int i = 0; i < 3; i++) r[i] = zero[i] - 2 * mz / mm * m[i];
    b[0] = nvec[1] * r[2] - nvec[2] * r[1];
    b[1] = nvec[2] * r[0] - nvec[0] * r[2];
    b[2] = nvec[0] * r[1] - nvec[1] * r[0];
    for (int i = 0; i < 3; i++) {
      frame[3 * i] = nvec[i];
      frame[3 * i + 1] = cp * r[i] + sp * b[i];
      frame[3 * i + 2] = cp * b[i] - sp * r[i];
      for (int k = 0; k < 3; k++) tframe[3 * k + i] = frame[3 * i + k];
    }
    product(tframe, hand, seen);
    for (int e = 0; e < 2; e++) {
      real side = e ? -1 : 1, across = side * B / G, X[9], M[9], unbent[9], q[2][3];
      for (int j = 0; j < 3; j++) {
        real middle = across * Ks[3 + j] + skewed * Ks[6 + j];
        X[j] = cb * Ks[j] + sb * middle;
        X[3 + j] = sb * Ks[j] - cb * middle;
        X[6 + j] = skewed * Ks[3 + j] - across * Ks[6 + j];
      }
      product(frame, X, M);
      triple(M, q[0]);
      for (int j = 0; j < 3; j++) {
        real middle = sb * seen[j] - cb * seen[3 + j], x = cb * seen[j] + sb * seen[3 + j];
        real y = across * middle + skewed * seen[6 + j];
        unbent[j] = cos_a * x + side * sin_a * y;
        unbent[3 + j] = cos_a * y - side * sin_a * x;
        unbent[6 + j] = skewed * middle - across * seen[6 + j];
      }
      product(J, unbent, M);
      triple(M, q[1]);
      real q4 = straight + side * 2 * ATAN2(sh, ch);
      for (int solution = 0; solution < 4; solution++) {
        int s = solution >> 1, t = solution & 1;
        real *to = out + (long)(4 * s + 2 * e + t) * 7 * n + row;
        const int flips[2] = {s, t};
        const real deltas[2] = {delta_s, delta_w};
        for (int k = 0; k < 2; k++) {
          real *v = to + 4 * k * n, half0 = q[k][0] > 0 ? -pi : pi, half2 = q[k][2] > 0 ? -pi : pi;
          v[0] = flips[k] ? q[k][0] + half0 : q[k][0];
          v[n] = (flips[k] ? -q[k][1] : q[k][1]) - deltas[k];
          v[2 * n] = flips[k] ? q[k][2] + half2 : q[k][2];
        }
        to[3 * n] = q4;
      }
    }
  }
}

/* Blocks of W closed loops, one a lane. The functions and the sizes N, NS, NP, ... come before this text. */

typedef struct {
  int64_t ticks;             /* control periods */
  int64_t substeps;          /* physics steps in each */
  int64_t every;             /* samples between logged ones */
  int64_t rows;              /* logged samples; 0 for no log */
  double period, physics_step, runaway;
  const double *law_shared;      /* (ticks + 1, NL) */
  const double *physics_shared;  /* (ticks * substeps, NX) */
  const double *weights;         /* (changes, NW): of what is carried, then of what is new */
  const int32_t *change;         /* (ticks + 1): 0 none, else 1 + index of the weights; negative where something is gripped */
} Plan;

enum { INPUT = 2 * N + NP + GIVEN * NS, RESULT = 2 * N + NM + 3 };

#define FOR(i, n) for (int i = 0; i < (n); i++)

static inline I below(const V *v, double limit) /* every |v[i]| < limit; false for NaN */
{
  I ok = v_i(-1);
  FOR(i, N) ok &= v_mask(v_fabs(v[i]) < v_all(limit));
  return ok;
}

static void noise(const int64_t *seed, int64_t sample, V *out)
{
#if NN > 0
  /* as k1607_pin.simulation.noise; each source has its own seeds */
  for (int source = 0, first = 0; source < NSEED; first += noise_size[source], source++) {
    uint64_t stream[W];
    FOR(k, W) stream[k] = mixed(mixed((uint64_t)seed[source * W + k] + ODD) + (uint64_t)sample * ODD);
    for (int pair = 0; 2 * pair < noise_size[source]; pair++) {
      double a[W], b[W];
      FOR(k, W) {
        a[k] = (double)(int64_t)(mixed(stream[k] + (uint64_t)(2 * pair + 1) * ODD) >> 12) * 0x1p-52 + 0x1p-53;
        b[k] = (double)(int64_t)(mixed(stream[k] + (uint64_t)(2 * pair + 2) * ODD) >> 12) * 0x1p-52 + 0x1p-53;
      }
      V u, angle, s, c;
      memcpy(&u, a, sizeof u);
      memcpy(&angle, b, sizeof angle);
      const V radius = v_sqrt(-2.0 * v_log(u));
      v_sincos(angle * 6.283185307179586, &s, &c);
      out[first + 2 * pair] = radius * c;
      if (2 * pair + 1 < noise_size[source]) out[first + 2 * pair + 1] = radius * s;
    }
  }
#else
  (void)seed, (void)sample, (void)out;
#endif
}

static void advance(const double *shared, const V *q, const V *v, const V *tau, const V *P, const V *pi, const V *H, V *q2, V *v2)
{
#if STAGES == 1
  motion(shared, q, v, tau, 0, 0, P, pi, H, 0, q2, v2);
#else
  V k[STAGES * N], qs[N], vs[N];
  acceleration(shared, q, v, tau, 0, 0, P, pi, H, 0, k);
  STAGE_CALLS
  finish(0, q, v, tau, 0, 0, P, pi, H, k, q2, v2);
#endif
}

static void block(const Plan *plan, const double *in, const int64_t *seeds, double *result, double *log)
{
  V q[N], v[N], q2[N], v2[N], q0[N], tau[N], P[NP + 1], pi[NPI + 1], H[NH + 1], state[2][NS + 1], metrics[2][NM + 1];
  V noises[NN + 1], row[NLOG + 1], work = v_all(0.0), counted = v_all(0.0), failed = v_all(NAN);
  I alive = v_i(-1);
  int now = 0;
  memcpy(q, in, sizeof q);
  memcpy(v, in + N * W, sizeof v);
  memcpy(P, in + 2 * N * W, NP * sizeof(V));
  FOR(i, NPI) pi[i] = v_all(0.0);
#if GIVEN
  memcpy(state[0], in + (2 * N + NP) * W, NS * sizeof(V));
#else
  initial(plan->law_shared, q, v, 0, 0, 0, P, pi, 0, 0, state[0]);
#endif
  FOR(i, NM) metrics[0][i] = v_all(metric_start[i]);
  hoist(0, q, v, 0, 0, 0, P, pi, 0, 0, H);
  for (int64_t k = 0; k <= plan->ticks; k++) {
#if NPI > 0
    if (plan->change[k]) {
      const double *weights = plan->weights + (llabs(plan->change[k]) - 1) * NW;
      payload(weights, q, v, 0, 0, 0, P, 0, 0, 0, pi);
#if GRIP
      if (plan->change[k] < 0) {
        grip(weights, q, v, 0, 0, 0, P, pi, 0, 0, v2);
        FOR(i, N) v[i] = v_select(alive, v2[i], v[i]);
      }
#endif
      hoist(0, q, v, 0, 0, 0, P, pi, 0, 0, H);
    }
#endif
    noise(seeds, k, noises);
    law(plan->law_shared + k * NL, q, v, 0, state[now], noises, P, pi, H, metrics[now], tau, state[1 - now], metrics[1 - now], row);
    const I finite = below(tau, INFINITY);
    if (v_any(alive & ~finite)) {
      failed = v_select(alive & ~finite, v_all(k * plan->period), failed);
      alive &= finite;
    }
    counted += v_where(alive, v_all(1.0));
    if (v_any(~alive)) FOR(i, NM) metrics[1 - now][i] = v_select(alive, metrics[1 - now][i], metrics[now][i]);
    now = 1 - now;
    if (plan->rows && k % plan->every == 0) {
      FOR(i, NLOG) row[i] = v_select(alive, row[i], v_all(NAN));
      memcpy(log + (k / plan->every) * NLOG * W, row, NLOG * sizeof(V));
    }
    if (k == plan->ticks) break;
    if (!v_any(alive)) {
      if (!plan->rows) break;
      continue;
    }
    memcpy(q0, q, sizeof q);
    const I moving = alive;
    for (int64_t s = 0; s < plan->substeps; s++) {
      const double *shared = plan->physics_shared + (k * plan->substeps + s) * NX;
      advance(shared, q, v, tau, P, pi, H, q2, v2);
      const I ok = below(v2, plan->runaway) & alive;
      if (v_any(alive & ~ok)) {
        failed = v_select(alive & ~ok, v_all(k * plan->period + s * plan->physics_step), failed);
        alive = ok;
      }
      if (v_any(~alive)) {
        FOR(i, N) q[i] = v_select(alive, q2[i], q[i]), v[i] = v_select(alive, v2[i], v[i]);
      } else {
        memcpy(q, q2, sizeof q);
        memcpy(v, v2, sizeof v);
      }
    }
    V done = v_all(0.0);
    FOR(i, N) done += tau[i] * (q[i] - q0[i]);
    work += v_select(moving, done, v_all(0.0)); /* up to the last good state */
  }
  V *out = (V *)result;
  FOR(i, N) out[i] = q[i], out[N + i] = v[i];
  FOR(i, NM) out[2 * N + i] = metrics[now][i];
  out[2 * N + NM] = counted;
  out[2 * N + NM + 1] = work;
  out[2 * N + NM + 2] = failed;
}

void rollout(const Plan *plan, int64_t blocks, const double *in, const int64_t *seeds, double *results, double *log)
{
  for (int64_t b = 0; b < blocks; b++)
    block(plan, in + b * INPUT * W, seeds + b * NSEED * W, results + b * RESULT * W, log + b * plan->rows * NLOG * W);
}

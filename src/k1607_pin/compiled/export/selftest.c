/* How a function is compared with what is known of it. The functions and their cases come after this text. */
#include <math.h>
#include <stdio.h>
#include <string.h>

/* SHARE: an entry is measured by its largest number, or by this of the largest of all entries; NOTHING: what is no more is but
   rounding, and has no scale */

typedef struct {
  const char *name;
  int size;
  int kept; /* where among the inputs it is, if it is changed in place; else -1 */
  double tolerance; /* what rounding may do */
} Result;

typedef struct {
  const char *name;
  int (*call)(const double *in, double *out); /* all arguments in a row */
  int inputs, outputs, cases, results;
  const double *given, *expected;
  const Result *result;
} Function;

static double buffer_in[MOST], buffer_out[MOST], buffer_all[MOST_IN_ALL];

/* The largest number that is known of one entry of the results. */
static double scale(const Function *f, int entry)
{
  double largest = 0.0;
  for (int k = 0; k < f->cases; k++) largest = fmax(largest, fabs(f->expected[k * f->outputs + entry]));
  return largest;
}

/* The largest difference of one result, over all cases and entries, as a share of the entry's largest number. */
static double difference(const Function *f, int first, const Result *r)
{
  double largest = 0.0, most = 0.0;
  for (int i = 0; i < r->size; i++) largest = fmax(largest, scale(f, first + i));
  for (int i = 0; i < r->size; i++) {
    const double size = largest > NOTHING ? fmax(scale(f, first + i), SHARE * largest) : 1.0;
    for (int k = 0; k < f->cases; k++) {
      const double off = fabs(buffer_all[k * f->outputs + first + i] - f->expected[k * f->outputs + first + i]) / size;
      if (!(off <= most)) most = off; /* NaN too, for good: nothing is less */
      if (most != most) return INFINITY;
    }
  }
  return most;
}

/* How often a number that is not finite was not refused, with all results zero and what is changed in place as it was. */
static int not_refused(const Function *f)
{
  const double bad[] = {NAN, INFINITY};
  int count = 0;
  for (int i = 0; i < 2 * f->inputs; i++) {
    int ok, first = 0;
    memcpy(buffer_in, f->given, (size_t)f->inputs * sizeof(double));
    buffer_in[i / 2] = bad[i % 2];
    ok = f->call(buffer_in, buffer_out) == 1;
    for (int k = 0; k < f->results; first += f->result[k].size, k++) {
      const Result *r = f->result + k;
      if (r->kept >= 0)
        ok &= memcmp(buffer_out + first, buffer_in + r->kept, (size_t)r->size * sizeof(double)) == 0;
      else
        for (int j = 0; j < r->size; j++) ok &= buffer_out[first + j] == 0.0;
    }
    count += !ok;
  }
  return count;
}

static int failures(const Function *f)
{
  int failed = 0, first = 0;
  const int accepted = not_refused(f);
  double worst = 0.0;
  for (int k = 0; k < f->cases; k++)
    if (f->call(f->given + k * f->inputs, buffer_all + k * f->outputs) != 0) {
      printf("FAILED  %s: case %d is refused\n", f->name, k);
      return 1;
    }
  for (int k = 0; k < f->results; first += f->result[k].size, k++) {
    const double off = difference(f, first, f->result + k);
    worst = fmax(worst, off);
    if (!(off <= f->result[k].tolerance)) {
      printf("FAILED  %s: %s is off by %.1e of its size\n", f->name, f->result[k].name, off);
      failed++;
    }
  }
  if (accepted) {
    printf("FAILED  %s: %d of %d arguments that are not finite went through\n", f->name, accepted, 2 * f->inputs);
    failed++;
  }
  if (!failed) printf("ok      %s: %d states, off by %.1e at most; refuses what is not finite\n", f->name, f->cases, worst);
  return failed;
}

/* SPDX-License-Identifier: MIT */
/*
 * Asks a monitor about a stream of records and writes its verdicts. `monitor_checks.h` is made for a
 * monitor: it says how many numbers a record has and which check is asked. `target_read` and
 * `target_write` are those of the host or of the target, and end the program where they fail.
 *
 * A record is numbers of the monitor's kind: which check, the state before, the state after, the
 * parameters. A verdict is a 32-bit id and a number, by how much the condition is missed; of a sound
 * monitor, 1 where it is unknown.
 */
#include "target.h"

#include <stdint.h>
#include <string.h>

#include "monitor_checks.h"

enum { RECORD = 1 + 2 * STATE + PARAMETERS, BATCH = 64, BYTES = sizeof(int32_t) + sizeof(real) };

static void ask(const real *record, unsigned char *answer)
{
  monitor_state before, after;
  monitor_parameters parameters;
  memcpy(&before, record + 1, sizeof before);
  memcpy(&after, record + 1 + STATE, sizeof after);
  memset(&parameters, 0, sizeof parameters);
  memcpy(&parameters, record + 1 + 2 * STATE, PARAMETERS * sizeof(real));
  const monitor_verdict verdict = monitor_check((int)record[0], &before, &after, &parameters);
  const int32_t id = verdict.id;
  const real value = monitor_value(&verdict);
  memcpy(answer, &id, sizeof id);
  memcpy(answer + sizeof id, &value, sizeof value);
}

int main(void)
{
  static real records[BATCH * RECORD];
  static unsigned char answers[BATCH * BYTES];
  for (;;) {
    const size_t count = target_read(records, sizeof records) / (RECORD * sizeof(real));
    if (count == 0)
      return 0;
    for (size_t k = 0; k < count; k++)
      ask(records + k * RECORD, answers + k * BYTES);
    target_write(answers, count * BYTES);
  }
}

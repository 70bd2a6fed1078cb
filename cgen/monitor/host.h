/* SPDX-License-Identifier: MIT-0 */
/*
 * host.h -- reads lines of numbers and has them answered: the program around an exported monitor.
 *
 * `main.c` of a monitor holds a copy, after `real`, MOST (numbers on a line at most), LENGTH (characters of
 * a line at most), STRTOREAL, BLANK (what stands between numbers) and USAGE (the forms of lines). `expected`
 * is how many numbers belong to a word, -1 for an unknown one; `answer` prints what a line asks for. Of a
 * controller and its policy MODEL, CHOICES (those of the controller), OBSERVATIONS, OUTPUTS and MADE (choices
 * that the policy makes, of which CHOICES are printed) are words of the monitor's.
 */
#ifndef DL2C_MONITOR_HOST_H
#define DL2C_MONITOR_HOST_H

static int expected(const char *word);
static void answer(const char *word, const real *from);

static const real *numbers_of(char *text, int *count)
{
  static real numbers[MOST];
  *count = 0;
  for (char *part = strtok(text, BLANK); part != NULL; part = strtok(NULL, BLANK)) {
    char *end;
    if (*count == MOST)
      return NULL;
    numbers[(*count)++] = STRTOREAL(part, &end);
    if (*end != '\0')
      return NULL;
  }
  return numbers;
}

static int refuse(long number, const char *why)
{
  fprintf(stderr, "line %ld: %s; a line is one of\n%s", number, why, USAGE);
  return 2;
}

/* Answers lines about the controller: a run of its choices, or the fallback under the monitor. */
static bool controls(const char *word, const real *from)
{
  const bool run = strcmp(word, "run") == 0;
  MODEL_state state;
  MODEL_parameters parameters;
  MODEL_input input;
  if (!run && strcmp(word, "fallback") != 0)
    return false;
  from = read_state(&state, from);
  from = read_parameters(&parameters, from);
  from = read_input(&input, from);
  MODEL_state post = state;
  if (run) {
    int choices[CHOICES + 1] = {0};
    for (int k = 0; k < CHOICES; k++)
      choices[k] = (int)from[k];
    printf("%d ", MODEL_run(state, &parameters, &input, choices, &post));
  } else
    post = MODEL_monitored_ctrl(state, &parameters, &input, 0, 0);
  print_state(&post);
  puts("");
  return true;
}

/* Answers lines about the policy: its outputs, and what it asks for or what is done under the monitor. */
static bool acts(const char *word, const real *from)
{
  const bool asks = strcmp(word, "asks") == 0;
  MODEL_state state;
  MODEL_parameters parameters;
  MODEL_input input;
  real observation[OBSERVATIONS], output[OUTPUTS];
  if (!asks && strcmp(word, "policy") != 0)
    return false;
  from = read_state(&state, from);
  from = read_parameters(&parameters, from);
  (void)read_input(&input, from);
  MODEL_policy_observe(state, &parameters, &input, observation);
  MODEL_policy_outputs(observation, output);
  for (int k = 0; k < OUTPUTS; k++)
    printf("%.17g ", (double)output[k]);
  if (asks) {
    MODEL_input asked;
    int choices[MADE];
    MODEL_policy_asks(state, &parameters, &input, &asked, choices);
    print_input(&asked);
    for (int k = 0; k < CHOICES; k++)
      printf("%d ", choices[k]);
  } else {
    const MODEL_state post = MODEL_policy_monitored(state, &parameters, &input);
    print_state(&post);
  }
  puts("");
  return true;
}

/*
 * Reads lines of a word and numbers, as `--help` lists them, and prints for each what it asks
 * for. Exits with 2 at the first line that is none of these.
 */
int main(int argc, char **argv)
{
  char line[LENGTH];
  if (argc > 1) {
    fputs(USAGE, stdout);
    return strcmp(argv[1], "--help") == 0 ? 0 : 2;
  }
  for (long number = 1; fgets(line, sizeof line, stdin) != NULL; number++) {
    if (strchr(line, '\n') == NULL && !feof(stdin))
      return refuse(number, "too long");
    char word[16] = "";
    int length = 0, count = 0;
    if (sscanf(line, "%15s%n", word, &length) != 1)
      continue;
    const real *const numbers = numbers_of(line + length, &count);
    if (expected(word) < 0)
      return refuse(number, "an unknown word");
    if (numbers == NULL || count != expected(word))
      return refuse(number, "other than the numbers that belong to its word");
    answer(word, numbers);
  }
  return 0;
}

#endif

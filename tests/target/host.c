/* SPDX-License-Identifier: MIT */
/* Records from standard input, verdicts to standard output. */
#include "target.h"

#include <stdio.h>
#include <stdlib.h>

size_t target_read(void *to, size_t size) { return fread(to, 1, size, stdin); }

void target_write(const void *from, size_t size)
{
  if (fwrite(from, 1, size, stdout) != size)
    exit(1);
}

/* SPDX-License-Identifier: MIT */
/* Where records come from and verdicts go. */
#ifndef TARGET_H
#define TARGET_H

#include <stddef.h>

/* Fills `to` as far as there are bytes; how many. */
size_t target_read(void *to, size_t size);
void target_write(const void *from, size_t size);

#endif

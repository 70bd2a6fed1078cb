/* SPDX-License-Identifier: MIT */
/*
 * A Cortex-M4 from reset to `main`, with files of the host by semihosting: records from `records`,
 * verdicts to `verdicts`.
 */
#include "target.h"

#include <stdint.h>

enum { SYS_OPEN = 0x01, SYS_WRITE = 0x05, SYS_READ = 0x06, SYS_EXIT_EXTENDED = 0x20 };
enum { READ_BINARY = 1, WRITE_BINARY = 5 };

#define ADP_STOPPED_APPLICATION_EXIT 0x20026u
#define COPROCESSOR_ACCESS (*(volatile uint32_t *)0xE000ED88u)
#define FLOATING_POINT_FULL_ACCESS (0xFu << 20)

extern uint32_t data_in_flash[], data_begin[], data_end[], bss_begin[], bss_end[], stack_top[];
int main(void);
void reset(void);
static void fault(void);

__attribute__((section(".vectors"), used)) static const uintptr_t vectors[16] = {
  (uintptr_t)stack_top, (uintptr_t)reset, (uintptr_t)fault, (uintptr_t)fault,
  (uintptr_t)fault,     (uintptr_t)fault, (uintptr_t)fault,
};

static uintptr_t request(uintptr_t operation, const void *arguments)
{
  register uintptr_t r0 __asm__("r0") = operation;
  register const void *r1 __asm__("r1") = arguments;
  __asm__ volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
  return r0;
}

static _Noreturn void stop(uintptr_t code)
{
  const uintptr_t arguments[2] = {ADP_STOPPED_APPLICATION_EXIT, code};
  for (;;)
    request(SYS_EXIT_EXTENDED, arguments);
}

static void fault(void) { stop(3); }

static uintptr_t opened(const char *name, uintptr_t length, uintptr_t mode)
{
  const uintptr_t arguments[3] = {(uintptr_t)name, mode, length};
  const uintptr_t handle = request(SYS_OPEN, arguments);
  if (handle == (uintptr_t)-1)
    stop(2);
  return handle;
}

size_t target_read(void *to, size_t size)
{
  static uintptr_t handle;
  if (handle == 0)
    handle = opened("records", 7, READ_BINARY);
  const uintptr_t arguments[3] = {handle, (uintptr_t)to, size};
  return size - request(SYS_READ, arguments);
}

void target_write(const void *from, size_t size)
{
  static uintptr_t handle;
  if (handle == 0)
    handle = opened("verdicts", 8, WRITE_BINARY);
  const uintptr_t arguments[3] = {handle, (uintptr_t)from, size};
  if (request(SYS_WRITE, arguments) != 0)
    stop(2);
}

__attribute__((noreturn)) void reset(void)
{
  for (uint32_t *to = data_begin, *from = data_in_flash; to < data_end;)
    *to++ = *from++;
  for (uint32_t *to = bss_begin; to < bss_end;)
    *to++ = 0;
#ifdef __ARM_FP
  COPROCESSOR_ACCESS |= FLOATING_POINT_FULL_ACCESS;
  __asm__ volatile("dsb\n\tisb" ::: "memory");
#endif
  stop((uintptr_t)main());
}

/* SPDX-License-Identifier: MIT-0 */
/* search.c -- the library of search.h, which knows no model: questions come as tables. */
#include "parts.h"

#if defined(_WIN32)
#define DL2C_EXPORT __declspec(dllexport)
#else
#define DL2C_EXPORT __attribute__((visibility("default")))
#endif

DL2C_EXPORT int dl2c_search_judge(const dl2c_question *q, const double *boxes, int64_t count,
                                  uint8_t *verdicts, uint8_t *splits, int threads);
DL2C_EXPORT int dl2c_search_linear(const dl2c_question *q, const double *box, double *linear);
DL2C_EXPORT int dl2c_search_middle(const dl2c_question *q, const double *box, double *point);
DL2C_EXPORT int dl2c_search_ranges(const dl2c_question *q, const double *boxes, int64_t count, double *ranges);
DL2C_EXPORT int64_t dl2c_search_inside(const dl2c_question *q, const double *boxes, int64_t count);

int dl2c_search_judge(const dl2c_question *q, const double *boxes, int64_t count, uint8_t *verdicts,
                      uint8_t *splits, int threads)
{
  return dl2c_judge(q, boxes, count, verdicts, splits, threads) ? 1 : 0;
}

int dl2c_search_linear(const dl2c_question *q, const double *box, double *linear)
{
  return dl2c_linear_bounds(q, box, linear) ? 1 : 0;
}

int dl2c_search_middle(const dl2c_question *q, const double *box, double *point)
{
  return dl2c_middle(q, box, point) ? 1 : 0;
}

int dl2c_search_ranges(const dl2c_question *q, const double *boxes, int64_t count, double *ranges)
{
  return dl2c_ranges(q, boxes, count, ranges) ? 1 : 0;
}

int64_t dl2c_search_inside(const dl2c_question *q, const double *boxes, int64_t count)
{
  return dl2c_inside(q, boxes, count);
}

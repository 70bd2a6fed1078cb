/* SPDX-License-Identifier: MIT-0 */
/*
 * sundials.h -- the functions of SUNDIALS CVODES that flows are solved with.
 *
 * By default they come at run time from the CVODES inside the casadi wheel, whose interface is
 * that of SUNDIALS 2.6; `dl2c_solver_library` names the file. With DL2C_SUNDIALS_SYSTEM they
 * are those of an installed SUNDIALS, version 6 or 7, linked as usual. What differs between the two
 * ends in this file: `DL2C_SUN(f)` is function f, a `dl2c_engine` is one solver memory.
 *
 * The wheel exports no CVDense, CVDiag and CVDlsSetDenseJacFn: the linear systems of stiff
 * flows go to CVSpgmr, whose preconditioner solves them.
 */
#ifndef DL2C_SUNDIALS_H
#define DL2C_SUNDIALS_H

#include "dl2c.h"
#include "numbers.h"

#include <stddef.h>

/* Rows of Nordsieck's array that are read, from row 0 on; of a step of higher order none are. */
#ifndef DL2C_NORDSIECK
#define DL2C_NORDSIECK 7
#endif

/* That array: row i is the i-th derivative at the end of the last step, times h^i / i!. */
typedef struct dl2c_nordsieck {
  const real *row[DL2C_NORDSIECK]; /* NULL where it is not known */
  real inverse;                    /* 1 / h */
} dl2c_nordsieck;

#ifdef DL2C_SUNDIALS_SYSTEM
#include "sundials_system.h"
#else
#include "sundials_casadi.h"
#endif

#endif

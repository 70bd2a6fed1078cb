/* SPDX-License-Identifier: MIT-0 */
/* What steps are made of: the parts of stepping.c. */
#ifndef DL2C_PARTS_H
#define DL2C_PARTS_H

#define PY_SSIZE_T_CLEAN
#include <Python.h>

#define NPY_NO_DEPRECATED_API NPY_1_7_API_VERSION
#include <numpy/arrayobject.h>

#include "dl2c.h"

/* The results that are numbers, as dl2c/native/results.py lays them out. */
typedef struct dl2c_results {
  double reward, duration, time;
  int32_t status, reason, cost;
  uint8_t terminated, truncated, blocked, postcondition, saturated, began;
} dl2c_results;

typedef dl2c_status (*dl2c_stepping)(dl2c_batch *batch);

/*
 * The parts of a step, a tuple. Addresses are integers; what they point to lives as long as the
 * batch, which `check` keeps. All arrays are contiguous.
 */
enum {
  STEP,    /* address of dl2c_batch_step, */
  BATCH,   /* of a batch */
  TURN,    /* list: whoever works on the batch takes its second entry meanwhile */
  CLOSING, /* list: not empty where the batch is to be freed then, */
  REFUSE,  /* f(): raises why there is no turn */
  SETTLE,  /* f(): frees the batch unless somebody has the turn */
  CHECK,   /* f(status): raises what a status that is not DL2C_OK stands for */
  WRITE,   /* f(action): requests any action, or raises what is wrong with it */
  RELEASE, /* whether others may run meanwhile: to take the lock again costs half a quick step */
  COMMON
};

/*
 * A source is an array, to be copied, or a pair of one and the dtype of the copy, or a dict of sources, or
 * a function that makes something. The other parts for a single environment:
 */
enum {
  RESULTS = COMMON, /* array of the results, */
  CHOICE,           /* of the requested choices */
  INPUT,            /* and inputs */
  COUNT,            /* where actions are the alternatives 0, ..., COUNT - 1 of that choice; or else 0 */
  WIDTH,            /* where actions are values of all so many inputs; or else 0 */
  NAMED,            /* where actions are a dict: its keys, what they are of and, but for inputs, how many */
  ENDED,            /* f(): told that the episode is over */
  OBSERVE,          /* source of the observation */
  KEYS,             /* those of `info` that are named below */
  INFO,             /* `info` of a step that nothing is to be said of, with all keys but the last */
  STATUSES,         /* names of statuses and of reasons by number */
  REASONS,
  SOURCES, /* keys of `info` and their sources in turn: what is made anew in every step */
  PARTS_OF_ONE
};

/* Those for many. */
enum {
  REQUESTS = COMMON, /* where actions are an array: that of the requested choices or inputs; or else None */
  COUNTS,            /* array of how many alternatives each of those choices has */
  RETURNED,          /* tuple of sources: what a step returns */
  PARTS_OF_MANY
};

enum { STATUS, REASON, COST, BLOCKED, DURATION, TIME, POSTCONDITION, SATURATED, IS_SUCCESS, NKEYS };

static PyObject *dl2c_part(PyObject *parts, int part) { return PyTuple_GET_ITEM(parts, part); }

static void *dl2c_address(PyObject *parts, int part)
{
  return PyLong_AsVoidPtr(dl2c_part(parts, part));
}

static void *dl2c_data(PyObject *parts, int part)
{
  return PyArray_DATA((PyArrayObject *)dl2c_part(parts, part));
}

/* Sets an entry and lets go of its value; a value of NULL stands for an error that was raised. */
static int dl2c_set(PyObject *info, PyObject *key, PyObject *value)
{
  const int failed = value == NULL ? -1 : PyDict_SetItem(info, key, value);
  Py_XDECREF(value);
  return failed;
}

#endif

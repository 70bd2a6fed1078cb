/* SPDX-License-Identifier: MIT-0 */
/*
 * The step of a single environment as a Python function of its action. It does what `python_step`
 * of dl2c/env/stepping.py does and returns the same objects; it knows no model. Part of no build of
 * one: an extension module of its own, which dl2c/native/single.py builds where Python's headers
 * are.
 */
#define PY_SSIZE_T_CLEAN
#include <Python.h>

#define NPY_NO_DEPRECATED_API NPY_1_7_API_VERSION
#include <numpy/arrayobject.h>
#include <string.h>

#include "dl2c.h"

/* The results that are numbers, as `outcome_memory` of dl2c/native/binding.py lays them out. */
typedef struct dl2c_results {
  double reward, duration, time;
  int32_t status, reason, cost;
  uint8_t terminated, truncated, blocked, postcondition, saturated, began;
} dl2c_results;

typedef dl2c_status (*dl2c_stepping)(dl2c_batch *batch);

/*
 * The parts of a step, a tuple. Addresses are integers; what they point to lives as long as the
 * batch, which `check` keeps. A source is a contiguous array, to be copied, or a function that
 * makes something.
 */
enum {
  STEP,     /* address of dl2c_batch_step, */
  BATCH,    /* of a batch of one, */
  RESULTS,  /* of its results, */
  CHOICE,   /* and of its first requested choice */
  COUNT,    /* where actions are the alternatives 0, ..., COUNT - 1 of that choice; or else 0 */
  WRITE,    /* f(action): requests any action, or raises what is wrong with it */
  RELEASE,  /* whether others may run meanwhile: to take the lock again costs half a quick step */
  CHECK,    /* f(status): raises what a status that is not DL2C_OK stands for */
  ENDED,    /* f(): told that the episode is over */
  OBSERVE,  /* source of the observation */
  KEYS,     /* those of `info` that are named below */
  INFO,     /* `info` of a step that nothing is to be said of, with all keys but the last */
  STATUSES, /* names of statuses and of reasons by number */
  REASONS,
  SOURCES, /* keys of `info` and their sources in turn: what is made anew in every step */
  PARTS
};

enum { STATUS, REASON, COST, BLOCKED, DURATION, TIME, POSTCONDITION, SATURATED, IS_SUCCESS, NKEYS };

static PyObject *dl2c_part(PyObject *parts, int part) { return PyTuple_GET_ITEM(parts, part); }

static void *dl2c_address(PyObject *parts, int part)
{
  return PyLong_AsVoidPtr(dl2c_part(parts, part));
}

/* Requests an action: at once if it is an alternative's number in any form, or else by WRITE. */
static int dl2c_request(PyObject *parts, PyObject *action)
{
  const Py_ssize_t count = PyLong_AsSsize_t(dl2c_part(parts, COUNT));
  if (count > 0 && PyIndex_Check(action)) {
    const Py_ssize_t given = PyNumber_AsSsize_t(action, NULL);
    if (given >= 0 && given < count) {
      *(int32_t *)dl2c_address(parts, CHOICE) = (int32_t)given;
      return 0;
    }
    PyErr_Clear();
  }
  PyObject *none = PyObject_CallOneArg(dl2c_part(parts, WRITE), action);
  Py_XDECREF(none);
  return none == NULL ? -1 : 0;
}

static int dl2c_advance(PyObject *parts)
{
  const dl2c_stepping step = (dl2c_stepping)(uintptr_t)dl2c_address(parts, STEP);
  dl2c_batch *batch = dl2c_address(parts, BATCH);
  PyThreadState *released = dl2c_part(parts, RELEASE) == Py_True ? PyEval_SaveThread() : NULL;
  const dl2c_status failed = step(batch);
  if (released != NULL) PyEval_RestoreThread(released);
  if (failed == DL2C_OK) return 0;
  Py_XDECREF(PyObject_CallFunction(dl2c_part(parts, CHECK), "i", (int)failed));
  return -1;
}

/* What a source holds or makes. */
static PyObject *dl2c_fresh(PyObject *source)
{
  if (!PyArray_Check(source)) return PyObject_CallNoArgs(source);
  PyArrayObject *array = (PyArrayObject *)source;
  PyObject *copy = PyArray_NewLikeArray(array, NPY_CORDER, NULL, 0);
  if (copy != NULL)
    memcpy(PyArray_DATA((PyArrayObject *)copy), PyArray_DATA(array), (size_t)PyArray_NBYTES(array));
  return copy;
}

static PyObject *dl2c_name(PyObject *names, long number)
{
  PyObject *key = PyLong_FromLong(number);
  PyObject *name = key == NULL ? NULL : PyObject_GetItem(names, key);
  Py_XDECREF(key);
  return name;
}

/* Sets an entry and lets go of its value; a value of NULL stands for an error that was raised. */
static int dl2c_set(PyObject *info, PyObject *key, PyObject *value)
{
  const int failed = value == NULL ? -1 : PyDict_SetItem(info, key, value);
  Py_XDECREF(value);
  return failed;
}

/* What is remarkable about a step, and how long it took. */
static int dl2c_tell(PyObject *parts, PyObject *info, const dl2c_results *r)
{
  PyObject *statuses = dl2c_part(parts, STATUSES), *reasons = dl2c_part(parts, REASONS);
  PyObject *const *key = &PyTuple_GET_ITEM(dl2c_part(parts, KEYS), 0);
  return (r->status != 0 && dl2c_set(info, key[STATUS], dl2c_name(statuses, r->status)) != 0) ||
         (r->reason != 0 && dl2c_set(info, key[REASON], dl2c_name(reasons, r->reason)) != 0) ||
         (r->cost != 0 && dl2c_set(info, key[COST], PyLong_FromLong(r->cost)) != 0) ||
         (r->blocked && dl2c_set(info, key[BLOCKED], PyBool_FromLong(1)) != 0) ||
         (!r->postcondition && dl2c_set(info, key[POSTCONDITION], PyBool_FromLong(0)) != 0) ||
         (r->saturated && dl2c_set(info, key[SATURATED], PyBool_FromLong(1)) != 0) ||
         dl2c_set(info, key[DURATION], PyFloat_FromDouble(r->duration)) != 0 ||
         dl2c_set(info, key[TIME], PyFloat_FromDouble(r->time)) != 0;
}

static int dl2c_fill(PyObject *parts, PyObject *info, const dl2c_results *r)
{
  PyObject *sources = dl2c_part(parts, SOURCES);
  for (Py_ssize_t i = 0; i < PyTuple_GET_SIZE(sources); i += 2) {
    PyObject *key = PyTuple_GET_ITEM(sources, i), *source = PyTuple_GET_ITEM(sources, i + 1);
    if (dl2c_set(info, key, dl2c_fresh(source)) != 0) return -1;
  }
  if (!r->terminated && !r->truncated) return 0;
  PyObject *none = PyObject_CallNoArgs(dl2c_part(parts, ENDED));
  Py_XDECREF(none);
  PyObject *key = PyTuple_GET_ITEM(dl2c_part(parts, KEYS), IS_SUCCESS);
  return none == NULL ? -1 : dl2c_set(info, key, PyBool_FromLong(r->status == DL2C_SUCCESS));
}

static PyObject *dl2c_step_one(PyObject *parts, PyObject *action)
{
  if (dl2c_request(parts, action) != 0 || dl2c_advance(parts) != 0) return NULL;
  const dl2c_results *r = dl2c_address(parts, RESULTS);
  PyObject *info = PyDict_Copy(dl2c_part(parts, INFO));
  if (info == NULL || dl2c_tell(parts, info, r) != 0 || dl2c_fill(parts, info, r) != 0) {
    Py_XDECREF(info);
    return NULL;
  }
  PyObject *observation = dl2c_fresh(dl2c_part(parts, OBSERVE));
  PyObject *terminated = PyBool_FromLong(r->terminated), *truncated = PyBool_FromLong(r->truncated);
  return Py_BuildValue("(NdNNN)", observation, r->reward, terminated, truncated, info);
}

static PyMethodDef dl2c_step_method = {"step", dl2c_step_one, METH_O, NULL};

static PyObject *dl2c_stepper(PyObject *module, PyObject *parts)
{
  (void)module;
  if (!PyTuple_CheckExact(parts) || PyTuple_GET_SIZE(parts) != PARTS ||
      PyObject_Size(dl2c_part(parts, KEYS)) != NKEYS) {
    PyErr_SetString(PyExc_TypeError, "a step is made of other parts");
    return NULL;
  }
  return PyCFunction_New(&dl2c_step_method, parts);
}

static PyMethodDef dl2c_methods[] = {{"stepper", dl2c_stepper, METH_O, NULL},
                                     {NULL, NULL, 0, NULL}};

static struct PyModuleDef dl2c_module = {
    .m_base = PyModuleDef_HEAD_INIT, .m_name = "single", .m_methods = dl2c_methods};

PyMODINIT_FUNC PyInit_single(void)
{
  import_array();
  return PyModule_Create(&dl2c_module);
}

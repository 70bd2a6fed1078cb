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
#include <math.h>
#include <string.h>

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
 * batch, which `check` keeps. A source is a contiguous array, to be copied, or a pair of one and the
 * dtype of the copy, or a dict of sources, or a function that makes something.
 */
enum {
  STEP,     /* address of dl2c_batch_step, */
  BATCH,    /* of a batch of one, */
  RESULTS,  /* of its results, */
  CHOICE,   /* and of its first requested choice */
  INPUT,    /* and input */
  TURN,     /* list: whoever works on the batch takes its second entry meanwhile */
  CLOSING,  /* list: not empty where the batch is to be freed then, */
  REFUSE,   /* f(): raises why there is no turn */
  SETTLE,   /* f(): frees the batch unless somebody has the turn */
  COUNT,    /* where actions are the alternatives 0, ..., COUNT - 1 of that choice; or else 0 */
  WIDTH,    /* where actions are values of all so many inputs; or else 0 */
  NAMED,    /* where actions are a dict: its keys, what they are of and, but for inputs, its alternatives */
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

/* Requests an alternative by its number, in any form. 0: it is none of `count`; -1: an error was raised. */
static int dl2c_request_choice(int32_t *choice, Py_ssize_t count, PyObject *action)
{
  if (count == 0 || !PyIndex_Check(action)) return 0;
  const Py_ssize_t given = PyNumber_AsSsize_t(action, NULL);
  if (given == -1 && PyErr_Occurred()) {
    if (!PyErr_ExceptionMatches(PyExc_TypeError)) return -1;
    PyErr_Clear();
  }
  if (given < 0 || given >= count) return 0;
  *choice = (int32_t)given;
  return 1;
}

/* Requests values of inputs. 0: they are not an array of `width` floats or doubles, or one is a NaN. */
static int dl2c_request_inputs(double *input, Py_ssize_t width, PyObject *action)
{
  if (width == 0 || !PyArray_CheckExact(action)) return 0;
  PyArrayObject *row = (PyArrayObject *)action;
  const int type = PyArray_TYPE(row);
  if (type != NPY_FLOAT && type != NPY_DOUBLE) return 0;
  if (PyArray_NDIM(row) != 1 || PyArray_DIM(row, 0) != width || !PyArray_ISBEHAVED_RO(row)) return 0;
  for (Py_ssize_t k = 0; k < width; k++) {
    const void *at = PyArray_GETPTR1(row, k);
    input[k] = type == NPY_FLOAT ? (double)*(const float *)at : *(const double *)at;
    if (isnan(input[k])) return 0;
  }
  return 1;
}

/*
 * Requests what a dict says of each decision. 0: it has other keys, or values of other forms; -1: an
 * error was raised.
 */
static int dl2c_request_named(PyObject *parts, PyObject *action)
{
  PyObject *named = dl2c_part(parts, NAMED);
  const Py_ssize_t size = PyTuple_GET_SIZE(named);
  if (size == 0 || !PyDict_CheckExact(action) || 3 * PyDict_GET_SIZE(action) != size) return 0;
  int32_t *choices = dl2c_address(parts, CHOICE);
  double *inputs = dl2c_address(parts, INPUT);
  for (Py_ssize_t i = 0; i < size; i += 3) {
    PyObject *value = PyDict_GetItem(action, PyTuple_GET_ITEM(named, i));
    const Py_ssize_t place = PyLong_AsSsize_t(PyTuple_GET_ITEM(named, i + 1));
    const Py_ssize_t count = PyLong_AsSsize_t(PyTuple_GET_ITEM(named, i + 2));
    if (value == NULL) return 0;
    const int requested = count > 0 ? dl2c_request_choice(choices + place, count, value)
                                    : dl2c_request_inputs(inputs + place, 1, value);
    if (requested != 1) return requested;
  }
  return 1;
}

/* Requests an action: at once if it is of the plainest form, or else by WRITE. */
static int dl2c_request(PyObject *parts, PyObject *action)
{
  const Py_ssize_t count = PyLong_AsSsize_t(dl2c_part(parts, COUNT));
  const Py_ssize_t width = PyLong_AsSsize_t(dl2c_part(parts, WIDTH));
  int requested = dl2c_request_choice(dl2c_address(parts, CHOICE), count, action);
  if (requested == 0) requested = dl2c_request_inputs(dl2c_address(parts, INPUT), width, action);
  if (requested == 0) requested = dl2c_request_named(parts, action);
  if (requested != 0) return requested < 0 ? -1 : 0;
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

/* Sets an entry and lets go of its value; a value of NULL stands for an error that was raised. */
static int dl2c_set(PyObject *info, PyObject *key, PyObject *value)
{
  const int failed = value == NULL ? -1 : PyDict_SetItem(info, key, value);
  Py_XDECREF(value);
  return failed;
}

/* What a source holds or makes. */
static PyObject *dl2c_fresh(PyObject *source)
{
  if (PyArray_Check(source)) {
    PyArrayObject *array = (PyArrayObject *)source;
    PyObject *copy = PyArray_NewLikeArray(array, NPY_CORDER, NULL, 0);
    if (copy != NULL)
      memcpy(PyArray_DATA((PyArrayObject *)copy), PyArray_DATA(array), (size_t)PyArray_NBYTES(array));
    return copy;
  }
  if (PyTuple_CheckExact(source)) {
    PyArray_Descr *type = (PyArray_Descr *)PyTuple_GET_ITEM(source, 1);
    Py_INCREF(type);
    PyObject *cast = PyArray_CastToType((PyArrayObject *)PyTuple_GET_ITEM(source, 0), type, 0);
    return cast == NULL ? NULL : PyArray_Return((PyArrayObject *)cast);
  }
  if (PyDict_CheckExact(source)) {
    PyObject *made = PyDict_New(), *key, *entry;
    Py_ssize_t at = 0;
    while (made != NULL && PyDict_Next(source, &at, &key, &entry))
      if (dl2c_set(made, key, dl2c_fresh(entry)) != 0) Py_CLEAR(made);
    return made;
  }
  return PyObject_CallNoArgs(source);
}

static PyObject *dl2c_name(PyObject *names, long number)
{
  PyObject *key = PyLong_FromLong(number);
  PyObject *name = key == NULL ? NULL : PyObject_GetItem(names, key);
  Py_XDECREF(key);
  return name;
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

/* Begins to work on the batch, which nobody frees meanwhile. */
static int dl2c_take_turn(PyObject *parts)
{
  PyObject *turn = dl2c_part(parts, TURN);
  if (PyList_GET_SIZE(turn) > 1) return PyList_SetSlice(turn, 1, 2, NULL);
  Py_XDECREF(PyObject_CallNoArgs(dl2c_part(parts, REFUSE)));
  return -1;
}

/* Lets others work on the batch. An error that was raised stays. */
static int dl2c_end_turn(PyObject *parts)
{
  PyObject *type, *value, *traceback;
  PyErr_Fetch(&type, &value, &traceback);
  int failed = PyList_Append(dl2c_part(parts, TURN), Py_True);
  if (failed == 0 && PyList_GET_SIZE(dl2c_part(parts, CLOSING)) > 0) {
    PyObject *none = PyObject_CallNoArgs(dl2c_part(parts, SETTLE));
    failed = none == NULL ? -1 : 0;
    Py_XDECREF(none);
  }
  if (type != NULL) PyErr_Restore(type, value, traceback);
  return failed;
}

static PyObject *dl2c_result(PyObject *parts)
{
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

static PyObject *dl2c_step_one(PyObject *parts, PyObject *action)
{
  if (dl2c_take_turn(parts) != 0) return NULL;
  PyObject *result = NULL;
  if (dl2c_request(parts, action) == 0 && dl2c_advance(parts) == 0) result = dl2c_result(parts);
  if (dl2c_end_turn(parts) != 0) Py_CLEAR(result);
  return result;
}

static PyMethodDef dl2c_step_method = {"step", dl2c_step_one, METH_O, NULL};

static PyObject *dl2c_stepper(PyObject *module, PyObject *parts)
{
  (void)module;
  if (!PyTuple_CheckExact(parts) || PyTuple_GET_SIZE(parts) != PARTS ||
      !PyList_CheckExact(dl2c_part(parts, TURN)) || !PyList_CheckExact(dl2c_part(parts, CLOSING)) ||
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

/* SPDX-License-Identifier: MIT-0 */
/*
 * Steps of a single environment and of many as Python functions of the action, and infos of many. They do
 * what `python_step`, `python_steps` and `python_infos` of dl2c/env/stepping.py do and return the same
 * objects; they know no model. Also steps of a batch, for `Batch.step` of dl2c/native/binding.py. Part of no
 * build of a model: an extension module of its own, which dl2c/native/stepping.py builds where Python's
 * headers are.
 */
#include "infos.h"
#include "parts.h"

#include <math.h>
#include <string.h>

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
  int32_t *choices = dl2c_data(parts, CHOICE);
  double *inputs = dl2c_data(parts, INPUT);
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

/* Requests an action of the plainest form. 0: it is of another one; -1: an error was raised. */
static int dl2c_request_one(PyObject *parts, PyObject *action)
{
  const Py_ssize_t count = PyLong_AsSsize_t(dl2c_part(parts, COUNT));
  const Py_ssize_t width = PyLong_AsSsize_t(dl2c_part(parts, WIDTH));
  int requested = dl2c_request_choice(dl2c_data(parts, CHOICE), count, action);
  if (requested == 0) requested = dl2c_request_inputs(dl2c_data(parts, INPUT), width, action);
  if (requested == 0) requested = dl2c_request_named(parts, action);
  return requested;
}

/* Requests n alternatives of each choice. 0: some are not among its `counts`.   given, choices: (n, width) */
static int dl2c_request_alternatives(int32_t *choices, const int64_t *given, npy_intp n, npy_intp width,
                                     const int64_t *counts)
{
  uint64_t outside = 0; /* the highest bit says it, which is quicker than to compare */
  for (npy_intp k = 0; k < width; k++) {
    const uint64_t last = (uint64_t)counts[k] - 1;
    for (npy_intp i = k; i < n * width; i += width) {
      outside |= (uint64_t)given[i] | (last - (uint64_t)given[i]);
      choices[i] = (int32_t)given[i];
    }
  }
  return !(outside >> 63);
}

/* Requests values of all inputs. 0: they are of another type, or one is a NaN; -1: an error was raised. */
static int dl2c_request_values(PyArrayObject *inputs, PyArrayObject *given)
{
  if (PyArray_TYPE(given) != NPY_FLOAT && PyArray_TYPE(given) != NPY_DOUBLE) return 0;
  if (PyArray_CopyInto(inputs, given) != 0) return -1;
  const double *input = PyArray_DATA(inputs);
  int nan = 0;
  for (npy_intp i = 0; i < PyArray_SIZE(inputs); i++) nan |= isnan(input[i]);
  return !nan;
}

/* Requests actions of all environments. 0: they are of another form, or not all valid; -1: an error. */
static int dl2c_request_many(PyObject *parts, PyObject *action)
{
  if (!PyArray_CheckExact(dl2c_part(parts, REQUESTS)) || !PyArray_CheckExact(action)) return 0;
  PyArrayObject *to = (PyArrayObject *)dl2c_part(parts, REQUESTS), *from = (PyArrayObject *)action;
  if (!PyArray_SAMESHAPE(to, from) || !PyArray_ISCARRAY_RO(from)) return 0;
  if (PyArray_TYPE(to) != NPY_INT32) return dl2c_request_values(to, from);
  if (PyArray_TYPE(from) != NPY_INT64) return 0;
  const npy_intp width = PyArray_SIZE((PyArrayObject *)dl2c_part(parts, COUNTS));
  return dl2c_request_alternatives(PyArray_DATA(to), PyArray_DATA(from), PyArray_SIZE(to) / width, width,
                                   dl2c_data(parts, COUNTS));
}

/* Requests an action by WRITE, unless it is `requested`. */
static int dl2c_request(PyObject *parts, PyObject *action, int requested)
{
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
  const dl2c_results *r = dl2c_data(parts, RESULTS);
  PyObject *info = PyDict_Copy(dl2c_part(parts, INFO));
  if (info == NULL || dl2c_tell(parts, info, r) != 0 || dl2c_fill(parts, info, r) != 0) {
    Py_XDECREF(info);
    return NULL;
  }
  PyObject *observation = dl2c_fresh(dl2c_part(parts, OBSERVE));
  PyObject *terminated = PyBool_FromLong(r->terminated), *truncated = PyBool_FromLong(r->truncated);
  return Py_BuildValue("(NdNNN)", observation, r->reward, terminated, truncated, info);
}

/* What a step of many returns. */
static PyObject *dl2c_copies(PyObject *parts)
{
  PyObject *sources = dl2c_part(parts, RETURNED);
  PyObject *copies = PyTuple_New(PyTuple_GET_SIZE(sources));
  for (Py_ssize_t i = 0; copies != NULL && i < PyTuple_GET_SIZE(sources); i++) {
    PyObject *copy = dl2c_fresh(PyTuple_GET_ITEM(sources, i));
    if (copy == NULL)
      Py_CLEAR(copies);
    else
      PyTuple_SET_ITEM(copies, i, copy);
  }
  return copies;
}

/* A step: `request` an action as far as it is of the plainest form, advance, and return a result. */
static PyObject *dl2c_step(PyObject *parts, PyObject *action, int (*request)(PyObject *, PyObject *),
                           PyObject *(*returned)(PyObject *))
{
  if (dl2c_take_turn(parts) != 0) return NULL;
  PyObject *result = NULL;
  if (dl2c_request(parts, action, request(parts, action)) == 0 && dl2c_advance(parts) == 0)
    result = returned(parts);
  if (dl2c_end_turn(parts) != 0) Py_CLEAR(result);
  return result;
}

static PyObject *dl2c_step_one(PyObject *parts, PyObject *action)
{
  return dl2c_step(parts, action, dl2c_request_one, dl2c_result);
}

static PyObject *dl2c_step_many(PyObject *parts, PyObject *action)
{
  return dl2c_step(parts, action, dl2c_request_many, dl2c_copies);
}

/* What is requested stands in the arrays of the batch. */
static int dl2c_request_nothing(PyObject *parts, PyObject *action)
{
  (void)parts, (void)action;
  return 1;
}

static PyObject *dl2c_nothing(PyObject *parts)
{
  (void)parts;
  Py_RETURN_NONE;
}

static PyObject *dl2c_step_batch(PyObject *parts, PyObject *none)
{
  return dl2c_step(parts, none, dl2c_request_nothing, dl2c_nothing);
}

/* Whether parts of a step are so many, and those that all steps have are what they should be. */
static int dl2c_are_parts(PyObject *parts, int size)
{
  return PyTuple_CheckExact(parts) && PyTuple_GET_SIZE(parts) == size &&
         PyList_CheckExact(dl2c_part(parts, TURN)) && PyList_CheckExact(dl2c_part(parts, CLOSING));
}

static int dl2c_is_array(PyObject *parts, int part) { return PyArray_CheckExact(dl2c_part(parts, part)); }

/* A step of its parts, if they fit. */
static PyObject *dl2c_made(PyMethodDef *step, PyObject *parts, int fit)
{
  if (fit) return PyCFunction_New(step, parts);
  PyErr_SetString(PyExc_TypeError, "a step is made of other parts");
  return NULL;
}

static PyMethodDef dl2c_method_of_one = {"step", dl2c_step_one, METH_O, NULL};
static PyMethodDef dl2c_method_of_many = {"step", dl2c_step_many, METH_O, NULL};
static PyMethodDef dl2c_method_of_batch = {"step", dl2c_step_batch, METH_NOARGS, NULL};

static PyObject *dl2c_one(PyObject *module, PyObject *parts)
{
  (void)module;
  const int fit = dl2c_are_parts(parts, PARTS_OF_ONE) && dl2c_is_array(parts, RESULTS) &&
                  dl2c_is_array(parts, CHOICE) && dl2c_is_array(parts, INPUT) &&
                  PyObject_Size(dl2c_part(parts, KEYS)) == NKEYS;
  return dl2c_made(&dl2c_method_of_one, parts, fit);
}

static PyObject *dl2c_many(PyObject *module, PyObject *parts)
{
  (void)module;
  const int fit = dl2c_are_parts(parts, PARTS_OF_MANY) && dl2c_is_array(parts, COUNTS) &&
                  PyTuple_CheckExact(dl2c_part(parts, RETURNED));
  return dl2c_made(&dl2c_method_of_many, parts, fit);
}

static PyObject *dl2c_batch_of(PyObject *module, PyObject *parts)
{
  (void)module;
  return dl2c_made(&dl2c_method_of_batch, parts, dl2c_are_parts(parts, COMMON));
}

static PyMethodDef dl2c_methods[] = {{"one", dl2c_one, METH_O, NULL},
                                     {"many", dl2c_many, METH_O, NULL},
                                     {"batch", dl2c_batch_of, METH_O, NULL},
                                     {"infos", dl2c_infos, METH_VARARGS, NULL},
                                     {NULL, NULL, 0, NULL}};

static struct PyModuleDef dl2c_module = {
    .m_base = PyModuleDef_HEAD_INIT, .m_name = "stepping", .m_methods = dl2c_methods};

PyMODINIT_FUNC PyInit_stepping(void)
{
  import_array();
  return PyModule_Create(&dl2c_module);
}

/* SPDX-License-Identifier: MIT-0 */
/* Infos of many environments, most of them empty. */
#ifndef DL2C_INFOS_H
#define DL2C_INFOS_H

#include <string.h>

#include "parts.h"

/* What an array has of environment i: a number or a copy of a row. */
static PyObject *dl2c_entry(PyArrayObject *array, npy_intp i)
{
  const void *at = PyArray_GETPTR1(array, i);
  if (PyArray_NDIM(array) == 1) return PyArray_GETITEM(array, at);
  PyArray_Descr *type = PyArray_DESCR(array);
  Py_INCREF(type);
  PyObject *row = PyArray_SimpleNewFromDescr(PyArray_NDIM(array) - 1, PyArray_DIMS(array) + 1, type);
  if (row == NULL) return NULL;
  PyArrayObject *copy = (PyArrayObject *)row;
  memcpy(PyArray_DATA(copy), at, (size_t)PyArray_NBYTES(copy));
  return row;
}

/* What a column, an array or a pair of one and names, has of environment i. */
static PyObject *dl2c_told(PyObject *column, npy_intp i)
{
  if (!PyTuple_CheckExact(column)) return dl2c_entry((PyArrayObject *)column, i);
  PyObject *number = dl2c_entry((PyArrayObject *)PyTuple_GET_ITEM(column, 0), i);
  PyObject *name = number == NULL ? NULL : PyObject_GetItem(PyTuple_GET_ITEM(column, 1), number);
  Py_XDECREF(number);
  return name;
}

/* The info of environment i; its keys are those of the columns. */
static PyObject *dl2c_info(PyObject *columns, npy_intp i)
{
  PyObject *info = PyDict_Copy(columns), *key, *column;
  Py_ssize_t at = 0;
  while (info != NULL && PyDict_Next(columns, &at, &key, &column))
    if (dl2c_set(info, key, dl2c_told(column, i)) != 0) Py_CLEAR(info);
  return info;
}

/* Whether it is an array of n numbers or rows of them, without gaps. */
static int dl2c_has_rows(PyObject *column, npy_intp n)
{
  if (!PyArray_CheckExact(column)) return 0;
  PyArrayObject *array = (PyArrayObject *)column;
  return PyArray_NDIM(array) > 0 && PyArray_DIM(array, 0) == n && PyArray_ISCARRAY_RO(array) &&
         !PyDataType_REFCHK(PyArray_DESCR(array));
}

static int dl2c_are_columns(PyObject *columns, npy_intp n)
{
  PyObject *key, *column;
  Py_ssize_t at = 0;
  while (PyDict_Next(columns, &at, &key, &column)) {
    const int named = PyTuple_CheckExact(column) && PyTuple_GET_SIZE(column) == 2;
    if (!dl2c_has_rows(named ? PyTuple_GET_ITEM(column, 0) : column, n)) return 0;
  }
  return 1;
}

/* An info for each environment: empty but where it is told. */
static PyObject *dl2c_list(const npy_bool *told, npy_intp n, PyObject *columns)
{
  PyObject *infos = PyList_New(n);
  for (npy_intp i = 0; infos != NULL && i < n; i++) {
    PyObject *info = told[i] ? dl2c_info(columns, i) : PyDict_New();
    if (info == NULL)
      Py_CLEAR(infos);
    else
      PyList_SET_ITEM(infos, i, info);
  }
  return infos;
}

/*
 * What `python_infos` of dl2c/env/stepping.py makes of the same arguments. Garbage is not collected
 * meanwhile: none of it is, and it would take as long again.
 */
static PyObject *dl2c_infos(PyObject *module, PyObject *arguments)
{
  (void)module;
  PyObject *told, *columns;
  if (!PyArg_ParseTuple(arguments, "O!O!", &PyArray_Type, &told, &PyDict_Type, &columns)) return NULL;
  const npy_intp n = PyArray_SIZE((PyArrayObject *)told);
  const int bools = PyArray_TYPE((PyArrayObject *)told) == NPY_BOOL && dl2c_has_rows(told, n);
  if (!bools || !dl2c_are_columns(columns, n)) {
    PyErr_SetString(PyExc_TypeError, "infos are made of other arrays");
    return NULL;
  }
  const int collecting = PyGC_Disable();
  PyObject *infos = dl2c_list(PyArray_DATA((PyArrayObject *)told), n, columns);
  if (collecting) PyGC_Enable();
  return infos;
}

#endif

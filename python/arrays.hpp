/// NumPy arrays from and for C++ arrays.
///
/// An array that the package returns is either a new array, or a read-only view of C++ memory whose owner is the
/// array's `base`, so that the memory exists as long as the array.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <array>
#include <cstdint>
#include <initializer_list>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "spm/model.hpp"

namespace tactus::python {

namespace py = pybind11;

/// Throws std::invalid_argument, in Python ValueError.
inline void require(bool condition, const std::string& message) {
  if (!condition) throw std::invalid_argument(message);
}

/// Any array of numbers. A conversion copies it.
using Numbers = py::array_t<double, py::array::c_style | py::array::forcecast>;

[[nodiscard]] std::string shape_text(const py::array& array);

/// Returns the rows of an array of shape (n, 3), which must outlive the span. Throws std::invalid_argument if a row is
/// not finite.
[[nodiscard]] std::span<const std::array<double, 3>> points_in(const Numbers& array, const char* name);
/// Returns the vector in an array of shape (3,). Throws std::invalid_argument if it is not finite.
[[nodiscard]] spm::Vec3d vector_in(const Numbers& array, const char* name);

/// A read-only view of an array of rows. `owner` becomes the base of the view.
template <class T, std::size_t columns>
py::array_t<T> view_of(std::span<const std::array<T, columns>> rows, py::handle owner) {
  py::array_t<T> view{{rows.size(), columns}, rows.empty() ? nullptr : rows.front().data(), owner};
  view.attr("setflags")(py::arg("write") = false);
  return view;
}

/// A field of a structured array: its name, its NumPy format such as "(3,)f8", and its offset in the record.
struct Field {
  const char* name;
  const char* format;
  std::size_t offset;
};
[[nodiscard]] py::dtype record_type(std::initializer_list<Field> fields, std::size_t bytes);

/// The type of a structured array of `Record`. It is set when the module is imported and exists until the process ends,
/// because to make a type takes as long as some ten queries.
template <class Record>
inline py::handle row_type_handle;
template <class Record>
void set_row_type(std::initializer_list<Field> fields) {
  row_type_handle<Record> = record_type(fields, sizeof(Record)).release();
}
template <class Record>
py::dtype row_type() {
  return py::reinterpret_borrow<py::dtype>(row_type_handle<Record>);
}

/// A read-only structured view of records. `owner` becomes the base of the view.
template <class Record>
py::array view_of_records(std::span<const Record> records, py::handle owner) {
  py::array view{row_type<Record>(), {records.size()}, {sizeof(Record)}, records.data(), owner};
  view.attr("setflags")(py::arg("write") = false);
  return view;
}

/// Moves `values` into an object that Python owns, for use as the owner of a view.
template <class T>
py::capsule owner_of(std::vector<T>&& values, std::vector<T>*& moved) {
  moved = new std::vector<T>(std::move(values));
  return py::capsule{moved, [](void* memory) { delete static_cast<std::vector<T>*>(memory); }};
}
/// A structured array that owns its records without a copy.
template <class Record>
py::array array_of_records(std::vector<Record>&& records) {
  std::vector<Record>* moved;
  const py::capsule owner = owner_of(std::move(records), moved);
  return py::array{row_type<Record>(), {moved->size()}, {sizeof(Record)}, moved->data(), owner};
}
/// An array of shape (n, columns) that owns its rows without a copy.
template <class T, std::size_t columns>
py::array_t<T> array_of_rows(std::vector<std::array<T, columns>>&& rows) {
  std::vector<std::array<T, columns>>* moved;
  const py::capsule owner = owner_of(std::move(rows), moved);
  return py::array_t<T>{{moved->size(), columns}, moved->empty() ? nullptr : moved->front().data(), owner};
}

}  // namespace tactus::python

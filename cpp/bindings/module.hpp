#pragma once

#include <nanobind/nanobind.h>

void init_bind(nanobind::module_& m);
void init_field(nanobind::module_& m);
void init_geodesics(nanobind::module_& m);
void init_pose(nanobind::module_& m);
void init_pose_gradients(nanobind::module_& m);

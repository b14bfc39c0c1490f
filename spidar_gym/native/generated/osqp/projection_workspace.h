/*
 * 
 * This file contains the prototype for the solver structure needed
 * by OSQP. The actual data is contained inside projection_workspace.c.
 */

#ifndef PROJECTION_WORKSPACE_H
#define PROJECTION_WORKSPACE_H

#include "osqp_api_types.h"

#ifdef __cplusplus
extern "C" {
#endif

  extern OSQPSolver projection_solver;

#ifdef __cplusplus
}
#endif

#endif /* ifndef PROJECTION_WORKSPACE_H */

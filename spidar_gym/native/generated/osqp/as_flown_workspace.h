/*
 * 
 * This file contains the prototype for the solver structure needed
 * by OSQP. The actual data is contained inside as_flown_workspace.c.
 */

#ifndef AS_FLOWN_WORKSPACE_H
#define AS_FLOWN_WORKSPACE_H

#include "osqp_api_types.h"

#ifdef __cplusplus
extern "C" {
#endif

  extern OSQPSolver as_flown_solver;

#ifdef __cplusplus
}
#endif

#endif /* ifndef AS_FLOWN_WORKSPACE_H */

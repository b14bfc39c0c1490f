/*
 * 
 * This file contains the prototype for the solver structure needed
 * by OSQP. The actual data is contained inside legs_workspace.c.
 */

#ifndef LEGS_WORKSPACE_H
#define LEGS_WORKSPACE_H

#include "osqp_api_types.h"

#ifdef __cplusplus
extern "C" {
#endif

  extern OSQPSolver legs_solver;

#ifdef __cplusplus
}
#endif

#endif /* ifndef LEGS_WORKSPACE_H */

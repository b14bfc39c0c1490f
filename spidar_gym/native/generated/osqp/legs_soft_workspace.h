/*
 * 
 * This file contains the prototype for the solver structure needed
 * by OSQP. The actual data is contained inside legs_soft_workspace.c.
 */

#ifndef LEGS_SOFT_WORKSPACE_H
#define LEGS_SOFT_WORKSPACE_H

#include "osqp_api_types.h"

#ifdef __cplusplus
extern "C" {
#endif

  extern OSQPSolver legs_soft_solver;

#ifdef __cplusplus
}
#endif

#endif /* ifndef LEGS_SOFT_WORKSPACE_H */

/*
 * 
 * This file contains the prototype for the solver structure needed
 * by OSQP. The actual data is contained inside leg_soft_workspace.c.
 */

#ifndef LEG_SOFT_WORKSPACE_H
#define LEG_SOFT_WORKSPACE_H

#include "osqp_api_types.h"

#ifdef __cplusplus
extern "C" {
#endif

  extern OSQPSolver leg_soft_solver;

#ifdef __cplusplus
}
#endif

#endif /* ifndef LEG_SOFT_WORKSPACE_H */

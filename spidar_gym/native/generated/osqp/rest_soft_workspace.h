/*
 * 
 * This file contains the prototype for the solver structure needed
 * by OSQP. The actual data is contained inside rest_soft_workspace.c.
 */

#ifndef REST_SOFT_WORKSPACE_H
#define REST_SOFT_WORKSPACE_H

#include "osqp_api_types.h"

#ifdef __cplusplus
extern "C" {
#endif

  extern OSQPSolver rest_soft_solver;

#ifdef __cplusplus
}
#endif

#endif /* ifndef REST_SOFT_WORKSPACE_H */

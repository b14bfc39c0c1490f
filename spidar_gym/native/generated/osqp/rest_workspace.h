/*
 * 
 * This file contains the prototype for the solver structure needed
 * by OSQP. The actual data is contained inside rest_workspace.c.
 */

#ifndef REST_WORKSPACE_H
#define REST_WORKSPACE_H

#include "osqp_api_types.h"

#ifdef __cplusplus
extern "C" {
#endif

  extern OSQPSolver rest_solver;

#ifdef __cplusplus
}
#endif

#endif /* ifndef REST_WORKSPACE_H */

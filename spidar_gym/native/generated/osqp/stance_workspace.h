/*
 * 
 * This file contains the prototype for the solver structure needed
 * by OSQP. The actual data is contained inside stance_workspace.c.
 */

#ifndef STANCE_WORKSPACE_H
#define STANCE_WORKSPACE_H

#include "osqp_api_types.h"

#ifdef __cplusplus
extern "C" {
#endif

  extern OSQPSolver stance_solver;

#ifdef __cplusplus
}
#endif

#endif /* ifndef STANCE_WORKSPACE_H */

/*
 * 
 * This file contains the prototype for the solver structure needed
 * by OSQP. The actual data is contained inside paper_soft_workspace.c.
 */

#ifndef PAPER_SOFT_WORKSPACE_H
#define PAPER_SOFT_WORKSPACE_H

#include "osqp_api_types.h"

#ifdef __cplusplus
extern "C" {
#endif

  extern OSQPSolver paper_soft_solver;

#ifdef __cplusplus
}
#endif

#endif /* ifndef PAPER_SOFT_WORKSPACE_H */

/* Generated: the workspace of OSQP for as_flown_soft. */
#ifndef AS_FLOWN_SOFT_WORKSPACE_H
#define AS_FLOWN_SOFT_WORKSPACE_H

#include <stddef.h>
#include <stdint.h>
#include "types.h"
#include "algebra_impl.h"
#include "qdldl_interface.h"

typedef struct {
    OSQPSettings settings;
    OSQPFloat sol_x[30];
    OSQPFloat sol_y[54];
    OSQPFloat sol_prim_inf_cert[54];
    OSQPFloat sol_dual_inf_cert[30];
    OSQPSolution sol;
    OSQPInfo info;
    OSQPInt data_P_csc_p[31];
    OSQPInt data_P_csc_i[90];
    OSQPFloat data_P_csc_x[90];
    OSQPCscMatrix data_P_csc;
    OSQPMatrix data_P;
    OSQPInt data_A_csc_p[31];
    OSQPInt data_A_csc_i[238];
    OSQPFloat data_A_csc_x[238];
    OSQPCscMatrix data_A_csc;
    OSQPMatrix data_A;
    OSQPFloat data_q_val[30];
    OSQPVectorf data_q;
    OSQPFloat data_l_val[54];
    OSQPVectorf data_l;
    OSQPFloat data_u_val[54];
    OSQPVectorf data_u;
    OSQPData data;
    OSQPInt linsys_L_p[85];
    OSQPInt linsys_L_i[313];
    OSQPFloat linsys_L_x[313];
    OSQPCscMatrix linsys_L;
    OSQPFloat linsys_Dinv[84];
    OSQPInt linsys_P[84];
    OSQPFloat linsys_bp[84];
    OSQPFloat linsys_sol[84];
    OSQPFloat linsys_rho_inv_vec[54];
    OSQPInt linsys_KKT_p[85];
    OSQPInt linsys_KKT_i[382];
    OSQPFloat linsys_KKT_x[382];
    OSQPCscMatrix linsys_KKT;
    OSQPInt linsys_PtoKKT[90];
    OSQPInt linsys_AtoKKT[238];
    OSQPInt linsys_rhotoKKT[54];
    OSQPFloat linsys_D[84];
    OSQPInt linsys_etree[84];
    OSQPInt linsys_Lnz[84];
    QDLDL_int linsys_iwork[252];
    QDLDL_bool linsys_bwork[84];
    QDLDL_float linsys_fwork[84];
    qdldl_solver linsys;
    OSQPFloat work_rho_vec_val[54];
    OSQPVectorf work_rho_vec;
    OSQPFloat work_rho_inv_vec_val[54];
    OSQPVectorf work_rho_inv_vec;
    OSQPInt work_constr_type_val[54];
    OSQPVectori work_constr_type;
    OSQPFloat work_x_val[30];
    OSQPVectorf work_x;
    OSQPFloat work_y_val[54];
    OSQPVectorf work_y;
    OSQPFloat work_z_val[54];
    OSQPVectorf work_z;
    OSQPFloat work_xz_tilde_val[84];
    OSQPVectorf work_xz_tilde;
    OSQPVectorf work_xtilde_view;
    OSQPVectorf work_ztilde_view;
    OSQPFloat work_x_prev_val[30];
    OSQPVectorf work_x_prev;
    OSQPFloat work_z_prev_val[54];
    OSQPVectorf work_z_prev;
    OSQPFloat work_Ax_val[54];
    OSQPVectorf work_Ax;
    OSQPFloat work_Px_val[30];
    OSQPVectorf work_Px;
    OSQPFloat work_Aty_val[30];
    OSQPVectorf work_Aty;
    OSQPFloat work_delta_y_val[54];
    OSQPVectorf work_delta_y;
    OSQPFloat work_Atdelta_y_val[30];
    OSQPVectorf work_Atdelta_y;
    OSQPFloat work_delta_x_val[30];
    OSQPVectorf work_delta_x;
    OSQPFloat work_Pdelta_x_val[30];
    OSQPVectorf work_Pdelta_x;
    OSQPFloat work_Adelta_x_val[54];
    OSQPVectorf work_Adelta_x;
    OSQPFloat work_D_temp_val[30];
    OSQPVectorf work_D_temp;
    OSQPFloat work_D_temp_A_val[30];
    OSQPVectorf work_D_temp_A;
    OSQPFloat work_E_temp_val[54];
    OSQPVectorf work_E_temp;
    OSQPWorkspace work;
    OSQPSolver solver;
} as_flown_soft_space;
extern const as_flown_soft_space as_flown_soft_SPACE;
static const uint32_t as_flown_soft_POINTERS[89] = {
    offsetof(as_flown_soft_space, sol) + offsetof(OSQPSolution, x), offsetof(as_flown_soft_space, sol) + offsetof(OSQPSolution, y), offsetof(as_flown_soft_space, sol) + offsetof(OSQPSolution, prim_inf_cert), offsetof(as_flown_soft_space, sol) + offsetof(OSQPSolution, dual_inf_cert),
    offsetof(as_flown_soft_space, data_P_csc) + offsetof(OSQPCscMatrix, p), offsetof(as_flown_soft_space, data_P_csc) + offsetof(OSQPCscMatrix, i), offsetof(as_flown_soft_space, data_P_csc) + offsetof(OSQPCscMatrix, x), offsetof(as_flown_soft_space, data_P) + offsetof(OSQPMatrix, csc),
    offsetof(as_flown_soft_space, data_A_csc) + offsetof(OSQPCscMatrix, p), offsetof(as_flown_soft_space, data_A_csc) + offsetof(OSQPCscMatrix, i), offsetof(as_flown_soft_space, data_A_csc) + offsetof(OSQPCscMatrix, x), offsetof(as_flown_soft_space, data_A) + offsetof(OSQPMatrix, csc),
    offsetof(as_flown_soft_space, data_q) + offsetof(OSQPVectorf, values), offsetof(as_flown_soft_space, data_l) + offsetof(OSQPVectorf, values), offsetof(as_flown_soft_space, data_u) + offsetof(OSQPVectorf, values), offsetof(as_flown_soft_space, data) + offsetof(OSQPData, P),
    offsetof(as_flown_soft_space, data) + offsetof(OSQPData, A), offsetof(as_flown_soft_space, data) + offsetof(OSQPData, q), offsetof(as_flown_soft_space, data) + offsetof(OSQPData, l), offsetof(as_flown_soft_space, data) + offsetof(OSQPData, u),
    offsetof(as_flown_soft_space, linsys_L) + offsetof(OSQPCscMatrix, p), offsetof(as_flown_soft_space, linsys_L) + offsetof(OSQPCscMatrix, i), offsetof(as_flown_soft_space, linsys_L) + offsetof(OSQPCscMatrix, x), offsetof(as_flown_soft_space, linsys_KKT) + offsetof(OSQPCscMatrix, p),
    offsetof(as_flown_soft_space, linsys_KKT) + offsetof(OSQPCscMatrix, i), offsetof(as_flown_soft_space, linsys_KKT) + offsetof(OSQPCscMatrix, x), offsetof(as_flown_soft_space, linsys) + offsetof(qdldl_solver, L), offsetof(as_flown_soft_space, linsys) + offsetof(qdldl_solver, Dinv),
    offsetof(as_flown_soft_space, linsys) + offsetof(qdldl_solver, P), offsetof(as_flown_soft_space, linsys) + offsetof(qdldl_solver, bp), offsetof(as_flown_soft_space, linsys) + offsetof(qdldl_solver, sol), offsetof(as_flown_soft_space, linsys) + offsetof(qdldl_solver, rho_inv_vec),
    offsetof(as_flown_soft_space, linsys) + offsetof(qdldl_solver, KKT), offsetof(as_flown_soft_space, linsys) + offsetof(qdldl_solver, PtoKKT), offsetof(as_flown_soft_space, linsys) + offsetof(qdldl_solver, AtoKKT), offsetof(as_flown_soft_space, linsys) + offsetof(qdldl_solver, rhotoKKT),
    offsetof(as_flown_soft_space, linsys) + offsetof(qdldl_solver, D), offsetof(as_flown_soft_space, linsys) + offsetof(qdldl_solver, etree), offsetof(as_flown_soft_space, linsys) + offsetof(qdldl_solver, Lnz), offsetof(as_flown_soft_space, linsys) + offsetof(qdldl_solver, iwork),
    offsetof(as_flown_soft_space, linsys) + offsetof(qdldl_solver, bwork), offsetof(as_flown_soft_space, linsys) + offsetof(qdldl_solver, fwork), offsetof(as_flown_soft_space, work_rho_vec) + offsetof(OSQPVectorf, values), offsetof(as_flown_soft_space, work_rho_inv_vec) + offsetof(OSQPVectorf, values),
    offsetof(as_flown_soft_space, work_constr_type) + offsetof(OSQPVectori, values), offsetof(as_flown_soft_space, work_x) + offsetof(OSQPVectorf, values), offsetof(as_flown_soft_space, work_y) + offsetof(OSQPVectorf, values), offsetof(as_flown_soft_space, work_z) + offsetof(OSQPVectorf, values),
    offsetof(as_flown_soft_space, work_xz_tilde) + offsetof(OSQPVectorf, values), offsetof(as_flown_soft_space, work_xtilde_view) + offsetof(OSQPVectorf, values), offsetof(as_flown_soft_space, work_ztilde_view) + offsetof(OSQPVectorf, values), offsetof(as_flown_soft_space, work_x_prev) + offsetof(OSQPVectorf, values),
    offsetof(as_flown_soft_space, work_z_prev) + offsetof(OSQPVectorf, values), offsetof(as_flown_soft_space, work_Ax) + offsetof(OSQPVectorf, values), offsetof(as_flown_soft_space, work_Px) + offsetof(OSQPVectorf, values), offsetof(as_flown_soft_space, work_Aty) + offsetof(OSQPVectorf, values),
    offsetof(as_flown_soft_space, work_delta_y) + offsetof(OSQPVectorf, values), offsetof(as_flown_soft_space, work_Atdelta_y) + offsetof(OSQPVectorf, values), offsetof(as_flown_soft_space, work_delta_x) + offsetof(OSQPVectorf, values), offsetof(as_flown_soft_space, work_Pdelta_x) + offsetof(OSQPVectorf, values),
    offsetof(as_flown_soft_space, work_Adelta_x) + offsetof(OSQPVectorf, values), offsetof(as_flown_soft_space, work_D_temp) + offsetof(OSQPVectorf, values), offsetof(as_flown_soft_space, work_D_temp_A) + offsetof(OSQPVectorf, values), offsetof(as_flown_soft_space, work_E_temp) + offsetof(OSQPVectorf, values),
    offsetof(as_flown_soft_space, work) + offsetof(OSQPWorkspace, data), offsetof(as_flown_soft_space, work) + offsetof(OSQPWorkspace, linsys_solver), offsetof(as_flown_soft_space, work) + offsetof(OSQPWorkspace, rho_vec), offsetof(as_flown_soft_space, work) + offsetof(OSQPWorkspace, rho_inv_vec),
    offsetof(as_flown_soft_space, work) + offsetof(OSQPWorkspace, constr_type), offsetof(as_flown_soft_space, work) + offsetof(OSQPWorkspace, x), offsetof(as_flown_soft_space, work) + offsetof(OSQPWorkspace, y), offsetof(as_flown_soft_space, work) + offsetof(OSQPWorkspace, z),
    offsetof(as_flown_soft_space, work) + offsetof(OSQPWorkspace, xz_tilde), offsetof(as_flown_soft_space, work) + offsetof(OSQPWorkspace, xtilde_view), offsetof(as_flown_soft_space, work) + offsetof(OSQPWorkspace, ztilde_view), offsetof(as_flown_soft_space, work) + offsetof(OSQPWorkspace, x_prev),
    offsetof(as_flown_soft_space, work) + offsetof(OSQPWorkspace, z_prev), offsetof(as_flown_soft_space, work) + offsetof(OSQPWorkspace, Ax), offsetof(as_flown_soft_space, work) + offsetof(OSQPWorkspace, Px), offsetof(as_flown_soft_space, work) + offsetof(OSQPWorkspace, Aty),
    offsetof(as_flown_soft_space, work) + offsetof(OSQPWorkspace, delta_y), offsetof(as_flown_soft_space, work) + offsetof(OSQPWorkspace, Atdelta_y), offsetof(as_flown_soft_space, work) + offsetof(OSQPWorkspace, delta_x), offsetof(as_flown_soft_space, work) + offsetof(OSQPWorkspace, Pdelta_x),
    offsetof(as_flown_soft_space, work) + offsetof(OSQPWorkspace, Adelta_x), offsetof(as_flown_soft_space, solver) + offsetof(OSQPSolver, settings), offsetof(as_flown_soft_space, solver) + offsetof(OSQPSolver, solution), offsetof(as_flown_soft_space, solver) + offsetof(OSQPSolver, info),
    offsetof(as_flown_soft_space, solver) + offsetof(OSQPSolver, work),
};

#endif
